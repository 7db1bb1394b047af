"""The rows of learning algorithms do what they count."""

from importlib.util import find_spec

import pytest
import torch

from benchmarks.report import document, table
from benchmarks.rows import learning
from benchmarks.rows.base import Row
from benchmarks.rows.learning import BATCH, Ours, StableBaselines3, TorchRLPPO
from benchmarks.speed import Measured


@pytest.mark.slow
def test_our_rows_count_steps_and_updates() -> None:
    """A run makes at least what it was asked for, and SAC's unit is shown with its rate."""
    torch.set_num_threads(1)
    ppo = Ours("ppo_same_schedule", "ppo_sb3", "ppo_sb3", 100, "env steps", "x")
    sac = Ours("sac", "sac", "sac_sb3", 10, "updates", "x")
    result = []
    for row, least in ((ppo, BATCH), (sac, 10)):
        row.build()
        timing = row.run()
        assert least <= timing.steps <= 2 * BATCH
        result.append(Measured(row, [timing], [0.0]))
    machine = {"cpu": "c", "cores": 2, "torch_threads": 1, "omp_num_threads": "1"}
    text = table(document(result, [], machine))
    assert " updates |" in text and " env steps |" not in text


@pytest.mark.parametrize(
    "row", [StableBaselines3("ppo_sb3", "PPO", BATCH), TorchRLPPO(1)], ids=lambda row: row.name
)
@pytest.mark.slow
def test_peers_train(row: Row, monkeypatch: pytest.MonkeyPatch) -> None:
    """An iteration changes the peer's actor; TorchRL's is a short one here."""
    if row.needs and not find_spec(row.needs):
        pytest.skip(f"needs {row.needs}")
    torch.set_num_threads(1)
    monkeypatch.setattr(learning, "BATCH", 128 if isinstance(row, TorchRLPPO) else BATCH)
    row.build()
    before = weights(row)
    assert row.run().steps == learning.BATCH
    assert not torch.equal(before, weights(row))
    row.close()


def weights(row: Row) -> torch.Tensor:
    """Return a peer's parameters."""
    if isinstance(row, TorchRLPPO):
        groups = row._update._optimizers[0].param_groups[0]["params"]
        return torch.cat([p.detach().flatten() for p in groups])
    assert isinstance(row, StableBaselines3)
    return torch.cat([p.detach().flatten() for p in row._learner.policy.parameters()])
