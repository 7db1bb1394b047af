"""Environments with transforms as rows: each row plays its own episode, whatever the others do."""

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDictBase
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import CatFrames, EnvBase, ObservationTransform, StepCounter

from envs.effects import make
from envs.mujoco import MujocoEnv
from envs.randomization import Draw, Randomization
from envs.tasks import Hopper
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.mlp_policy import mlp_policy
from sim2real.learning.population.env_rows import EnvRows
from sim2real.learning.population.population import Population, PopulationRequest
from sim2real.learning.transforms import RewardScaling, RunningNorm
from sim2real.runs.errors import Sim2RealError

TASKS = Randomization(
    [
        Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0),
        Draw(make("ground_friction"), low=1.5, high=2.5),
    ]
)
POLICY = partial(mlp_policy, hidden=(8,), activation="tanh", output="tanh", initial="normal")


class Doubled(ObservationTransform):
    """A user's own: twice what is shown."""

    def __init__(self) -> None:
        super().__init__(in_keys=["observation"], out_keys=["observation"])

    def _apply_transform(self, obs: torch.Tensor) -> torch.Tensor:
        return obs * 2

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)


def world(max_steps: int = 12, **transforms: Any) -> EnvironmentFactory:
    """Return short Hopper episodes with transforms."""
    return EnvironmentFactory(
        partial(MujocoEnv, task=Hopper(max_steps=max_steps)), TASKS, transforms
    )


def returns(environment: EnvironmentFactory, num_rows: int, scale: float = 1.0) -> np.ndarray:
    """Return what five members come to in two episodes each; `scale` is of what is shown."""
    policy = POLICY(environment.make(1, threads=1))
    rng = np.random.default_rng(0)
    thetas = rng.standard_normal((5, policy.num_parameters)).astype(np.float32)
    first = policy.pieces[0]
    thetas[:, first.start : first.stop] /= scale
    shards = [environment.rows(num_rows)]
    TASKS.check(shards[0].space)
    values = TASKS.sample(rng, 5)
    cohort = NoAdaptation().start_many(thetas, [rng] * 5)
    seeds = np.arange(10, dtype=np.uint64).reshape(5, 2)
    return (
        Population(shards, policy)
        .run(PopulationRequest(cohort, values, values, seeds), None)
        .returns
    )


@pytest.mark.parametrize("num_rows", [1, 3, 12])
def test_members_return_what_they_do_on_plain_rows(num_rows: int) -> None:
    """Robots, luck and ends are those of the simulator; a transform changes what is seen alone."""
    plain = returns(world(), 4)
    assert len(np.unique(plain)) == 10
    counted = world(max_steps=1000, steps=partial(StepCounter, max_steps=12))
    assert isinstance(counted.rows(1), EnvRows)
    np.testing.assert_allclose(returns(counted, num_rows), plain, rtol=1e-5)
    np.testing.assert_allclose(returns(world(mine=Doubled), num_rows, 2.0), plain, rtol=1e-5)


def test_rows_restart_alone_and_keep_frames_of_their_own() -> None:
    """A row that begins sees its first observation four times; the others go on."""
    stack = partial(CatFrames, N=4, dim=-1, in_keys=["observation"])
    rows = world(stack=stack).rows(3)
    TASKS.check(rows.space)
    assert rows.observation_size == 44
    ids, values = np.arange(3), TASKS.sample(np.random.default_rng(0), 3)
    first = rows.reset(ids, values, ids.astype(np.uint64))
    np.testing.assert_array_equal(first.reshape(3, 4, 11), np.tile(first[:, None, :11], (1, 4, 1)))
    action = np.full((3, 3), 0.3)
    later = rows.step(None, action).observation.reshape(3, 4, 11)
    np.testing.assert_array_equal(later[:, :3], first.reshape(3, 4, 11)[:, 1:])
    again = rows.reset(np.array([1]), values[1:2], np.array([1], np.uint64))
    np.testing.assert_array_equal(again[0], first[1])
    both = rows.step(None, action).observation.reshape(3, 4, 11)
    np.testing.assert_array_equal(both[[0, 2], 2], later[[0, 2], 3])
    np.testing.assert_array_equal(both[1], later[1])


def test_how_many_rows_changes_no_bit() -> None:
    """Among others, alone, or beside rows that have ended, an episode is the same."""
    stacked = world(stack=partial(CatFrames, N=2, dim=-1, in_keys=["observation"]))
    assert np.array_equal(returns(stacked, 1), returns(stacked, 7))


class Drift(EnvBase):
    """Somebody else's world: a point is moved, its pull is a parameter, its start is luck."""

    def __init__(self, num_envs: int = 1, device: str = "cpu", own: bool = False) -> None:
        super().__init__(device=device, batch_size=torch.Size([num_envs]))
        shape, self.own = torch.Size([num_envs, 1]), own
        self.place, self.pull, self.age = torch.zeros(shape), torch.full(shape, 0.5), 0
        inner = Composite({"pull": Unbounded(shape)}, shape=(num_envs,))
        self.observation_spec = Composite(
            observation=Unbounded(shape), params=inner, shape=(num_envs,)
        )
        self.action_spec = Bounded(-torch.ones(shape), torch.ones(shape), shape)
        self.reward_spec = Unbounded(shape)

    def _reset(
        self, tensordict: TensorDictBase | None = None, seeds: np.ndarray | None = None
    ) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        mask = torch.ones_like(self.place, dtype=torch.bool) if mask is None else mask
        given = None if tensordict is None else tensordict.get("params", None)
        if given is not None:
            self.pull = torch.where(mask, given["pull"], self.pull)
        assert seeds is not None
        drawn = [[np.random.default_rng(int(seed)).uniform()] for seed in seeds]
        start = torch.rand_like(self.place) if self.own else torch.tensor(drawn).float()
        self.place = torch.where(mask, start, self.place)
        return self._shown()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self.place = self.place + 0.1 * (tensordict["action"] - self.pull)
        return self._shown().set("reward", -self.place.abs())

    def _shown(self) -> TensorDictBase:
        out = self.observation_spec.zero().set("observation", self.place.clone())
        out["params", "pull"] = self.pull.clone()
        return out.update(self.full_done_spec.zero())

    def _set_seed(self, seed: int | None) -> None:
        """Each row has its own seed."""


class Deaf(Drift):
    """Takes no seeds."""

    def _reset(self, tensordict: TensorDictBase | None = None) -> TensorDictBase:  # type: ignore[override]
        return super()._reset(tensordict, np.zeros(self.batch_size[0], np.uint64))


def test_somebody_else_s_environment_is_rows_too() -> None:
    """Parameters and seeds reach the rows that restart; its own values are neutral."""
    limit = {"steps": partial(StepCounter, max_steps=3)}
    rows = EnvironmentFactory(partial(Drift), transforms=limit).rows(3)
    assert rows.space.names == ("pull",) and rows.space.neutral == [0.5]
    ids, values = np.array([0, 2]), np.array([[1.0], [0.0]])
    first = rows.reset(ids, values, np.array([7, 8], np.uint64))
    expected = [np.random.default_rng(seed).uniform() for seed in (7, 8)]
    np.testing.assert_allclose(first[:, 0], expected, rtol=1e-6)
    for number in range(3):
        step = rows.step(ids, np.zeros((2, 1)))
        assert step.truncated.tolist() == [number == 2] * 2 and not step.terminated.any()
    np.testing.assert_allclose(step.observation[:, 0], [expected[0] - 0.3, expected[1]], rtol=1e-5)


@pytest.mark.parametrize(
    ("environment", "sentence"),
    [
        (world(norm=RunningNorm), "a repetition differed: MujocoEnv with the"),
        (world(pay=partial(RewardScaling, 0.99)), "RewardScaling; remove transforms that keep"),
        (EnvironmentFactory(partial(Drift, own=True)), "Drift with the transforms none"),
        (EnvironmentFactory(partial(Deaf)), r"Deaf takes none .*; let its _reset take seeds"),
    ],
)
def test_what_rows_cannot_be_is_refused(environment: EnvironmentFactory, sentence: str) -> None:
    """Statistics of all rows, a generator of its own, no seeds: a sentence each."""
    with pytest.raises(Sim2RealError, match=sentence):
        environment.rows(4)
