"""A user's own transform, actor and loss, from a folder outside the repository."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sim2real.config import extensions
from sim2real.config.compose import compose, instantiate
from sim2real.config.targets import ConfigError
from sim2real.learning.algorithms.base import build
from sim2real.runs.errors import Sim2RealError

MODULE = """
import torch
from torch import nn
from torchrl.envs import ObservationTransform
from torchrl.objectives import ClipPPOLoss


class Doubled(ObservationTransform):
    def __init__(self, factor: float) -> None:
        super().__init__(in_keys=["observation"], out_keys=["observation"])
        self.factor = factor

    def _apply_transform(self, obs):
        return obs * self.factor

    def _reset(self, tensordict, tensordict_reset):
        return self._call(tensordict_reset)


class Sine(nn.Module):
    def __init__(self, in_features: int, out_features: int, width: int) -> None:
        super().__init__()
        self.first, self.last = nn.Linear(in_features, width), nn.Linear(width, out_features)

    def forward(self, x):
        return self.last(torch.sin(self.first(x)))


class Timid(ClipPPOLoss):
    calls = 0

    def forward(self, tensordict):
        Timid.calls += 1
        losses = super().forward(tensordict)
        return losses.set("loss_timid", 0.01 * tensordict["action"].square().mean() * 0)


class Needy(ClipPPOLoss):
    @property
    def in_keys(self):
        return [*super().in_keys, "wages"]


def policy(env):
    from sim2real.learning.modules.actor_critic import Policy
    return Policy(nn.Linear(11, 3), None)
"""
NETWORK = "{{_target_: my_parts.Sine, width: {}}}"
FILES = {
    "transforms/mine.yaml": "# mine\ndoubled: {_target_: my_parts.Doubled, factor: 2.0}\n",
    "policy/mine.yaml": "# mine\n_target_: sim2real.learning.modules.actor_critic.actor_critic\n"
    f"actor: {NETWORK.format(8)}\ncritic: {NETWORK.format(5)}\n",
    "policy/bare.yaml": "# mine\n_target_: my_parts.policy\n",
    "loss/mine.yaml": "# mine\n_target_: my_parts.Timid\n",
    "loss/needy.yaml": "# mine\n_target_: my_parts.Needy\n",
}
SMALL = ["algorithm=ppo_sb3", "env.task.max_steps=20", "algorithm.num_rows=4"]
SMALL += ["algorithm.steps=16", "algorithm.minibatch_size=32", "algorithm.epochs=1"]


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with a module and a choice of three groups, in use."""
    for name, text in {**FILES, "my_parts.py": MODULE}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    extensions.activate(tmp_path)
    return tmp_path


def test_a_user_s_transform_actor_and_loss_are_trained_with(own: Path) -> None:
    """Each is used, shown by the configuration, resumed and evaluated like one of the project's."""
    tree = compose([*SMALL, "transforms=mine", "policy=mine", "loss=mine", "seed=1"])
    assert tree["transforms"]["doubled"] == {"_target_": "my_parts.Doubled", "factor": 2.0}
    _, given = instantiate(tree, own / "out")
    made: list[Any] = [build(given["algorithm"], given["parts"]) for _ in range(2)]
    first, second = made
    first.iterate()
    assert sys.modules["my_parts"].Timid.calls == 2
    assert {type(m).__name__ for m in first.policy.actor.modules()} >= {"Sine"}
    env = first.collecting.env
    raw = env.base_env._last
    torch.testing.assert_close(
        first.collecting._collector._carrier["observation"], torch.from_numpy(2 * raw).float()
    )
    second.load_state_dict(first.state_dict())
    assert first.iterate() == second.iterate()
    assert (first.trained().run_episodes(np.arange(2, dtype=np.uint64)).lengths > 0).all()


def test_a_user_s_actor_and_transform_are_trained_by_evolution_strategies(own: Path) -> None:
    """The same parts adapt: members see what the transform shows, by the user's own network."""
    small = ["algorithm.pairs=2", "algorithm.num_rows=4", "env.task.max_steps=20"]
    words = ["+experiment=esmaml", "policy=mine", "transforms=mine", "video=none", "eval=none"]
    _, given = instantiate(compose([*words, *small]), own / "out")
    algorithm = build(given["algorithm"], given["parts"])
    first = algorithm.trained()
    assert {type(m).__name__ for m in first.actor(first.theta).modules()} >= {"Sine"}
    algorithm.iterate()
    assert np.abs(algorithm.trained().theta - first.theta).max() > 1e-4
    adapted = algorithm.adapted(np.array([4.0, 1.0]), np.random.default_rng(0))
    assert adapted is not None and adapted.shape == first.theta.shape


def test_what_does_not_fit_is_a_sentence(own: Path) -> None:
    """An actor that is no tensordict module, a loss that reads what is not there, no such class."""
    for words, sentence in (
        (["policy=bare"], "the actor is a Linear, no tensordict module; wrap it"),
        (["loss=needy"], "loss: Needy reads 'wages', which is missing; available: action,"),
    ):
        _, given = instantiate(compose([*SMALL, *words]), own / "out")
        with pytest.raises(Sim2RealError, match=sentence):
            build(given["algorithm"], given["parts"]).iterate()
    (own / "loss" / "gone.yaml").write_text("# mine\n_target_: my_parts.Gone\n_partial_: true\n")
    with pytest.raises(ConfigError, match=r"my_parts\.Gone: no such class"):
        compose([*SMALL, "loss=gone"])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("algorithm.clip_epsilon=0.1", "it is now loss.clip_epsilon"),
        ("algorithm.gamma=0.9", "it is now advantage.gamma"),
        ("algorithm.learning_rate=1e-3", "it is now optimizer.lr"),
        ("policy.hidden=[8]", "it is now policy.actor.num_cells"),
    ],
)
def test_an_old_key_is_answered_with_the_new_one(old: str, new: str) -> None:
    """Whoever types what was once right is told what is right now."""
    with pytest.raises(ConfigError, match=new):
        compose(["algorithm=ppo", old])
