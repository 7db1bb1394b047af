"""The collector of several processes: batches that a seed repeats, a training, and a clean end."""

import multiprocessing
from typing import Any

import pytest
import torch

from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import make_learner

SMALL = ["env=nav2d", "params=goals", "algorithm=ppo_sb3", "collector=processes"]
SMALL += ["algorithm.num_rows=4", "algorithm.steps=32", "algorithm.epochs=1"]


def learner(*words: str) -> Any:
    """Return what trains in two processes."""
    return make_learner([*SMALL, *words])


@pytest.mark.slow
def test_a_training_in_two_processes_repeats_and_ends() -> None:
    """Rows differ, the newest policy acts, a seed gets the same again, and no process is left."""
    ends = []
    for _ in range(2):
        algorithm = learner()
        collecting = algorithm.collecting
        first, data = algorithm.iterate(), collecting.next()
        assert first["train/frames"] == 128 and data.batch_size == (4, 32)
        assert data["observation"][0].ne(data["observation"][2]).any()
        with torch.no_grad():
            taken = algorithm.policy.actor.get_dist(data.clone())
        torch.testing.assert_close(taken.log_prob(data["action"]), data["action_log_prob"])
        ends.append(data["action"].clone())
        algorithm.close()
        algorithm.close()  # once more is nothing
        assert not multiprocessing.active_children()
    assert torch.equal(*ends)


@pytest.mark.slow
def test_a_resumed_training_begins_other_episodes() -> None:
    """Its rewards and actions are none of the run's first."""
    first, resumed = learner(), learner()
    begun, _ = first.collecting.next(), first.close()
    resumed.load_state_dict(first.state_dict())
    again, _ = resumed.collecting.next(), resumed.close()
    for key in ("action", ("next", "reward")):
        assert begun[key][:, 0].ne(again[key][:, 0]).all()


def test_what_processes_cannot_share_is_refused() -> None:
    """Statistics of all rows, and rows that do not divide."""
    with pytest.raises(Sim2RealError, match=r"collector\.workers=3 does not divide"):
        learner("collector.workers=3")
    with pytest.raises(Sim2RealError, match=r"RunningNorm.*use collector=sync"):
        learner("transforms=normalized")
