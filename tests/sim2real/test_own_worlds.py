"""A user's own environment, task, algorithm and preflight check, from a folder outside.

Each module below is all that the user writes. Transform, actor and loss are in
`learning/test_own_parts.py`, an effect in `test_own_effect.py`, a robot in
`config/test_extensions.py`, a log format in `tests/hardware/formats/test_formats.py`.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from hardware.log import Log
from sim2real.config import extensions
from sim2real.config.compose import compose, instantiate
from sim2real.diagnosis.preflight import checks
from sim2real.learning.algorithms.base import build
from sim2real.learning.environment import make_env
from tests.sim2real.trained import make_learner

ENV = """
import torch
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

class Point(EnvBase):
    def __init__(self, num_envs: int = 1, device: str = "cpu") -> None:
        super().__init__(device=device, batch_size=[num_envs])
        self.observation_spec = Composite(observation=Unbounded([num_envs, 2]), shape=[num_envs])
        self.action_spec = Bounded(-1.0, 1.0, [num_envs, 2])
        self.reward_spec = Unbounded([num_envs, 1])
    def _set_seed(self, seed):
        self.rng = torch.Generator().manual_seed(seed)
    def _reset(self, tensordict=None):
        self.place = torch.randn(*self.batch_size, 2, generator=self.rng)
        return self.full_done_spec.zero().set("observation", self.place)
    def _step(self, tensordict):
        self.place = self.place + 0.1 * tensordict["action"]
        reward = -self.place.norm(dim=-1, keepdim=True)
        return self.full_done_spec.zero().update({"observation": self.place, "reward": reward})
"""
TASK = """
from envs.tasks import Hopper

class Backwards(Hopper):
    def reward(self, before, after, action, terminated):
        return -super().reward(before, after, action, terminated)
"""
ALGORITHM = """
from sim2real.learning.algorithms.ppo import PPO

class Patient(PPO):
    def iterate(self) -> dict[str, float]:
        for _ in range(2):
            metrics = super().iterate()
        return metrics | {"train/patience": 2.0}
"""
CHECK = """
from sim2real.diagnosis.preflight.checks import register
from sim2real.diagnosis.schema import Finding

@register
def check_name(logs, models):
    for log in logs:
        if log.meta.get("operator") is None:
            yield Finding("operator", None, "Nobody signed this log.", "Add an operator.")
"""
FILES = {
    "my_env.py": ENV,
    "my_task.py": TASK,
    "my_algorithm.py": ALGORITHM,
    "my_check.py": CHECK,
    "env/point.yaml": "# mine\n_target_: my_env.Point\n",
    "env/backwards.yaml": "# mine\n_target_: envs.mujoco.MujocoEnv\n"
    "task: {_target_: my_task.Backwards, max_steps: 20}\n",
    "algorithm/patient.yaml": "# mine\ndefaults: [ppo_sb3]\n_target_: my_algorithm.Patient\n",
}
SMALL = ["algorithm.num_rows=4", "algorithm.steps=16", "algorithm.minibatch_size=32"]
SMALL += ["algorithm.epochs=1"]


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder, in use."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(checks, "CHECKS", list(checks.CHECKS))
    extensions.activate(tmp_path)
    return tmp_path


@pytest.mark.parametrize("text", [ENV, TASK, ALGORITHM, CHECK])
def test_twenty_lines_are_enough(text: str) -> None:
    """What a user writes stays small."""
    assert len([line for line in text.splitlines() if line.strip()]) <= 20


def test_an_environment_of_one_s_own_is_trained_in(own: Path) -> None:
    """Any EnvBase that takes num_envs gets transforms, a collector and a policy of its sizes."""
    tree = compose(["env=point", "algorithm=ppo_sb3", *SMALL, "seed=1"])
    assert make_env(tree, num_envs=3).rollout(4)["observation"].shape == (3, 4, 2)
    _, given = instantiate(tree, own / "out")
    learner = build(given["algorithm"], given["parts"])
    assert learner.iterate()["train/frames"] == 64


def test_a_resumed_run_starts_episodes_that_cannot_be_resumed(own: Path) -> None:
    """Nothing of the interrupted ones goes on in them: no length, no return, no frames."""
    limit = "+transforms.limit={_target_: torchrl.envs.StepCounter, max_steps: 12}"
    frames = "{_target_: torchrl.envs.CatFrames, N: 2, dim: -1, in_keys: [observation]}"
    words = ["env=point", "algorithm=ppo_sb3", "transforms=normalized", limit, *SMALL]
    words.append(f"+transforms.frames={frames}")
    first, second = (make_learner(words, own / "out") for _ in range(2))
    first.iterate()
    second.load_state_dict(first.state_dict())

    norm, scaling = (second.collecting.env.transform[i] for i in (1, 2))
    assert scaling._running is None and norm.moments["observation"].count == 4 * (1 + 16 + 1 + 1)
    mean, std = norm.affine()
    place = (second.collecting.env.base_env.place - mean) / std
    shown = second.collecting._collector._carrier["observation"]
    torch.testing.assert_close(shown, torch.cat([place, place], -1).float())
    assert second.iterate()["train/episode_length"] == 12
    assert first.iterate()["train/episode_length"] == 12  # it was not interrupted


def test_a_resumed_run_repeats_no_episode(own: Path) -> None:
    """Episodes that start anew are others than the run's first, and each checkpoint's are its own.

    A checkpoint is resumed in one way only.
    """
    words = ["env=point", "algorithm=ppo_sb3", *SMALL]
    first, *others = (make_learner(words, own / "out") for _ in range(4))
    env = first.collecting.env.made.make(4, seed=first.collecting.env.seed)
    starts, known = [], [env.reset()["observation"] for _ in range(5)]
    for learner in others[:2]:
        first.iterate()
        learner.load_state_dict(first.state_dict())
        starts.append(learner.collecting.env.base_env.place)
        assert not any(torch.equal(starts[-1], place) for place in known)
    assert not torch.equal(*starts)
    others[2].load_state_dict(first.state_dict())
    assert torch.equal(others[2].collecting.env.base_env.place, starts[-1])


def test_a_task_of_one_s_own_is_simulated(own: Path) -> None:
    """Its rewards are what its class says, on the same robot and under the same luck."""
    mine, ours = (
        make_env(compose([f"env={name}"]), num_envs=2, seed=3).rollout(5)
        for name in ("backwards", "hopper")
    )
    assert (mine["observation"] == ours["observation"])[:, 0].all()
    assert (mine["next", "reward"] == -ours["next", "reward"])[:, 0].sum() >= 0
    _, given = instantiate(compose(["env=backwards", "algorithm=ppo_sb3", *SMALL]), own / "out")
    assert build(given["algorithm"], given["parts"]).identity["task"] == "Backwards"


def test_an_algorithm_of_one_s_own_is_driven(own: Path) -> None:
    """A verb asks it for what `Algorithm` declares, and a checkpoint says whose it is."""
    _, given = instantiate(
        compose(["algorithm=patient", *SMALL, "env.max_steps=null"][:5]), own / "out"
    )
    learner = build(given["algorithm"], given["parts"])
    assert learner.iterate()["train/patience"] == 2.0
    assert learner.frames == 2 * 64
    assert learner.identity["algorithm"] == "Patient"


def test_a_check_of_one_s_own_is_asked(own: Path) -> None:
    """Its findings stand beside ours in every preflight."""
    extensions.load()
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body><joint name='a'/><geom size='0.1' pos='0.2 0 0'/></body>"
        "</worldbody><actuator><position name='a' joint='a' kp='5' kv='1'/></actuator></mujoco>"
    )
    time = 0.02 * np.arange(300)
    wave = 0.3 * np.sin(3 * time)
    log = Log({"episode": 0 * time, "time": time, "ctrl.a": wave, "qpos.a": wave})
    assert "operator" in [f.check for f in checks.preflight([log], [spec])]
    signed = Log(log.columns, {"operator": "me"})
    assert "operator" not in [f.check for f in checks.preflight([signed], [spec])]
