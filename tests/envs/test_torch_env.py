"""Rows as TorchRL environments."""

from typing import cast

import numpy as np
import pytest
import torch
from tensordict import TensorDictBase
from torchrl.collectors import Collector
from torchrl.envs import Compose, EnvBase, PendulumEnv, RewardSum, TransformedEnv
from torchrl.envs.utils import check_env_specs

from envs.effects import make
from envs.errors import ParameterError, TaskError
from envs.mujoco import MujocoEnv
from envs.randomization import Draw, Randomization
from envs.tasks import (
    Ant,
    HalfCheetah,
    Hopper,
    HopperPolito,
    InvertedPendulum,
    Swimmer,
    Task,
    Walker2d,
)
from envs.torch_env import RandomizeParams, RowsEnv
from envs.toys import Nav2D, NavGoals

MASS, FRICTION = ("params", "link_mass.torso"), ("params", "ground_friction")
TASKS = [
    Hopper(), HopperPolito(), Walker2d(), HalfCheetah(), Swimmer(), InvertedPendulum(), Ant(),
    Ant(contact_forces="exact"),
]  # fmt: skip


def randomization(per: str = "reset") -> Randomization:
    """Return uniform torso masses [1, 9] kg and ground frictions [1.5, 2.5]."""
    mass = Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0)
    return Randomization([mass, Draw(make("ground_friction"), low=1.5, high=2.5)], per)  # type: ignore[arg-type]


def randomized(
    n: int, per: str = "reset", task: Task | None = None, seed: int = 0
) -> TransformedEnv:
    """Return n Hoppers with parameters of their own."""
    tasks = randomization(per)
    env = MujocoEnv(task or Hopper(), n, tasks.effects, threads=1, seed=seed)
    return TransformedEnv(env, RandomizeParams(tasks))


@pytest.mark.parametrize("task", TASKS, ids=lambda task: type(task).__name__)
def test_specs_hold(task: Task) -> None:
    """What the environments return has the shapes, types and names of their specs."""
    check_env_specs(MujocoEnv(task, 3, threads=1))


@pytest.mark.parametrize("per", ["reset", "row"])
def test_specs_hold_with_parameters(per: str) -> None:
    """The parameters are part of the specs."""
    env = randomized(3, per)
    check_env_specs(env)
    assert MASS in env.observation_spec.keys(True, True)


def test_toys_are_environments_too() -> None:
    """Any rows and any distribution of tasks make an environment; the goals are its parameters."""
    base = RowsEnv(Nav2D(3))
    env = TransformedEnv(base, RandomizeParams(NavGoals()))
    check_env_specs(env)
    names = set(base.rows.space.names)
    assert {key[1] for key in env.rollout(2).keys(True) if key[0] == "params"} == names


def test_specs_hold_in_double_precision() -> None:
    """With dtype float64 the simulation's numbers are passed on unrounded."""
    env = MujocoEnv(Hopper(), 2, threads=1, dtype=torch.float64)
    check_env_specs(env)
    env.reset()
    observation = env.rand_step()["next", "observation"]
    assert observation.dtype == torch.float64
    state = env.simulation.plant.qpos[:, 1:]
    np.testing.assert_array_equal(observation[:, :5].numpy(), state)


def test_a_partial_reset_changes_only_the_masked_rows() -> None:
    """Rows outside the mask keep observation, parameters and physics; those in it start anew."""
    env = randomized(4)
    batch = cast(MujocoEnv, env.base_env).simulation.plant.batch
    td = env.rollout(8)[:, -1]["next"].clone()
    mask = torch.tensor([[False], [True], [False], [True]])
    state = batch.state.copy()
    after = env.reset(td.clone().set("_reset", mask))
    kept, fresh = ~mask[:, 0], mask[:, 0]
    for key in ("observation", MASS, FRICTION):
        assert torch.equal(after[key][kept], td[key][kept])
        assert (after[key][fresh] != td[key][fresh]).any()
    new = batch.state
    np.testing.assert_array_equal(new[kept.numpy()], state[kept.numpy()])
    assert (new[fresh.numpy()] != state[fresh.numpy()]).any(axis=1).all()


@pytest.mark.parametrize("per", ["reset", "row"])
def test_parameters_are_constant_within_an_episode(per: str) -> None:
    """They change exactly where an episode ends (per reset), or never (per row)."""
    rollout = randomized(8, per, Hopper(max_steps=12)).rollout(60, break_when_any_done=False)
    mass, done = rollout[MASS], rollout["next", "done"][..., 0]  # (N, T)
    changes = mass[:, 1:] != mass[:, :-1]
    assert done[:, :-1].any(dim=1).all()
    expected = done[:, :-1] if per == "reset" else torch.zeros_like(changes)
    assert torch.equal(changes, expected)
    assert torch.equal(rollout["next", *MASS], mass)  # a step's label is that of its own episode
    assert len(mass[:, 0].unique()) == 8
    assert ((mass >= 1.0) & (mass <= 9.0)).all()


def test_parameters_reach_the_physics() -> None:
    """The label is the mass and friction that the simulation runs with, and values can be given."""
    env = MujocoEnv(Hopper(), 2, randomization().effects, threads=1)
    td = env.reset()
    td[MASS][:] = torch.tensor([2.0, 7.0], dtype=torch.float64)
    td = env.reset(td)
    plant = env.simulation.plant
    np.testing.assert_array_equal(plant.batch.expand("body_mass")[:, 1], [2.0, 7.0])
    assert td[MASS].tolist() == [2.0, 7.0]
    td[MASS][1] = -1.0
    with pytest.raises(ParameterError, match=r"link_mass.torso = -1 kg .*\(row 1\)"):
        env.reset(td)


def test_a_seed_decides_everything() -> None:
    """Equal seeds give equal rollouts, parameters included; other seeds give others."""

    def run(seed: int) -> torch.Tensor:
        env = randomized(4)
        env.set_seed(seed)
        rows = env.rollout(
            40,
            lambda td: td.set("action", td["observation"][:, :3].tanh()),
            break_when_any_done=False,
        )
        return torch.cat([rows["observation"].double(), rows[MASS][..., None]], dim=-1)

    assert torch.equal(run(3), run(3))
    assert not torch.equal(run(3), run(4))


def test_the_time_limit_is_truncated() -> None:
    """Without a StepCounter, the limit's last step is truncated, not terminated."""
    rollout = MujocoEnv(HalfCheetah(max_steps=5), 2, threads=1).rollout(20)
    assert rollout.shape == (2, 5)
    assert rollout["next", "truncated"][:, -1].all()
    assert not rollout["next", "truncated"][:, :-1].any()
    assert not rollout["next", "terminated"].any()


def test_a_failed_row_is_flagged_and_restarts() -> None:
    """An action of NaN fails its row, which a rollout resets while the others go on."""
    env = MujocoEnv(HalfCheetah(), 3, threads=1)
    td = env.reset()
    td["action"] = torch.zeros(3, 6)
    td["action"][1] = torch.nan
    data, td = env.step_and_maybe_reset(td)
    assert data["next", "failed"][:, 0].tolist() == [False, True, False]
    assert data["next", "terminated"][:, 0].tolist() == [False, True, False]
    assert data["next", "reward"][1].item() == 0.0
    assert not td["done"].any()
    assert torch.isfinite(td["observation"]).all()
    assert torch.equal(td["observation"][0], data["next", "observation"][0])


def test_a_collector_drives_it() -> None:
    """TorchRL's collector fills batches over resets, and RewardSum sums each episode by itself."""
    tasks = randomization()
    base = MujocoEnv(Hopper(), 4, tasks.effects, threads=1)
    env = TransformedEnv(base, Compose(RandomizeParams(tasks), RewardSum()))  # pyright: ignore[reportCallIssue]
    collector = Collector(env, None, frames_per_batch=200, total_frames=400)
    batches = list(collector)
    assert [batch.shape for batch in batches] == [(4, 50), (4, 50)]
    batch = batches[1]
    ends = batch["next", "done"][..., 0]
    assert ends.any()
    changed = batch[MASS][:, 1:] != batch[MASS][:, :-1]
    assert torch.equal(changed, ends[:, :-1])
    first = batch["episode_reward"][:, 1:][ends[:, :-1]]
    assert (first == 0).all()


def test_what_was_returned_is_not_changed_later() -> None:
    """Tensors of earlier steps keep their values while the environment goes on."""
    env = randomized(2)
    td = env.reset()
    seen = []
    for _ in range(30):
        data, td = env.step_and_maybe_reset(env.rand_action(td))
        seen.append((data, data.clone()))
    for data, copy in seen:
        assert (data == copy).all()


def test_draws_are_checked_before_the_first_episode() -> None:
    """A distribution over another robot's parameters, or beyond its range, is refused at reset."""
    wrong = Randomization([Draw(make("link_mass", where="torso", how="set"), low=-1.0, high=9.0)])
    env = TransformedEnv(MujocoEnv(Hopper(), 2, wrong.effects, threads=1), RandomizeParams(wrong))
    with pytest.raises(ParameterError, match=r"link_mass.torso: draws reach \[-1, 9\] kg"):
        env.reset()
    with pytest.raises(ParameterError, match="made without"):
        TransformedEnv(MujocoEnv(Hopper(), 2, threads=1), RandomizeParams(randomization())).reset()


@pytest.mark.parametrize("per", ["reset", "row"])
def test_restarting_without_transforms_is_the_same(per: str) -> None:
    """Given its tasks directly, an environment returns what the transform makes it return."""
    tasks = randomization(per)
    direct = MujocoEnv(Hopper(max_steps=15), 4, tasks.effects, threads=1, tasks=tasks)
    check_env_specs(MujocoEnv(Hopper(), 2, tasks.effects, threads=1, tasks=tasks))

    def run(env: EnvBase) -> TensorDictBase:
        env.set_seed(2)
        return env.rollout(
            40,
            lambda td: td.set("action", td["observation"][:, :3].tanh()),
            break_when_any_done=False,
        )

    ours, expected = run(direct), run(randomized(4, per, Hopper(max_steps=15)))
    assert ours["next", "done"].any()
    assert set(ours.keys(True)) == set(expected.keys(True))
    for key in expected.keys(True, True):
        assert torch.equal(ours[key], expected[key]), key


def test_parameters_need_rows() -> None:
    """Over an environment of another kind the transform says what it is for."""
    env = TransformedEnv(PendulumEnv(), RandomizeParams(randomization()))
    with pytest.raises(TaskError, match="which PendulumEnv has not"):
        env.reset()
