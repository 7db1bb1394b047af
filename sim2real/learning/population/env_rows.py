"""Any TorchRL environment as rows, transforms included.

    rows = EnvRows(environment.make(32))              # restarts by mask, a seed for each row
    observation = rows.reset(ids, values, seeds)
    step = rows.step(ids, action)

The whole batch is stepped, rows without an episode too; one that ends there starts again, so that
the environment is never stepped past an end. A reset hands it ("params", name) of the rows' robots,
the mask "_reset", and the argument `seeds`, (N,) uint64, which alone determines the random numbers
of each row. That an episode depends on nothing else is tried out at the start, and what fails is
refused: transforms that keep statistics of all rows, and environments that draw by a generator of
their own.
"""

from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.envs import Transform, TransformedEnv
from torchrl.envs.utils import step_mdp

from envs.params import Parameter, ParamSpace
from envs.rows import Step
from envs.torch_env import RowsEnv
from sim2real.learning.modules.mlp_policy import action_limits, observation_size
from sim2real.runs.errors import Sim2RealError

TRIED = 3  # observations of the trial: that of the start and two more


class EnvRows:
    """Independent episodes in the rows of a batched environment.

    Args:
        env: the environment with all transforms except `RandomizeParams`, N rows on the CPU.

    Raises:
        Sim2RealError: the environment has no vector observation, accepts no seeds, or its episodes
            depend on more than robot, seed and actions.
    """

    def __init__(self, env: TransformedEnv) -> None:
        self._env, self._given = env, _GivenParams()
        env.append_transform(self._given)
        self.num_rows = env.batch_size[0]
        self.observation_size = observation_size(env)
        self.action_low, self.action_high = action_limits(env)
        self.action_size = len(self.action_low)
        base = env.base_env
        self.max_steps = base.rows.max_steps if isinstance(base, RowsEnv) else 0
        self._ids = np.arange(self.num_rows)
        self._seeds = np.zeros(self.num_rows, np.uint64)
        self._now = self._begin()
        self.space = _space(env, self._now)
        self._values = self.space.points(self.num_rows)  # (N, P)
        idle = np.clip(0.0, self.action_low, self.action_high)
        self._action = np.tile(idle, (self.num_rows, 1))  # (N, A)
        self._over = np.zeros(self.num_rows, bool)
        self._try()

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Start an episode in each of the rows ids (n,); see `Rows`."""
        self._values[ids], self._seeds[ids] = values, seeds
        self._restart(ids)
        return self._seen()[ids]

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Advance the rows ids (None: all of them) by one control step; see `Rows`."""
        ids = self._ids if ids is None else ids
        idle = self._over.copy()
        idle[ids] = False
        if idle.any():
            self._restart(np.flatnonzero(idle))
        self._action[ids] = action
        spec = self._env.action_spec
        self._now.set("action", torch.as_tensor(self._action, dtype=spec.dtype, device=spec.device))
        stepped = self._env.step(self._now)
        after = stepped["next"]
        self._now = step_mdp(stepped)
        self._over, terminated = self._flag(after, "done"), self._flag(after, "terminated")
        reward = after["reward"].reshape(self.num_rows).cpu().numpy().astype(np.float64)
        ends = (terminated, self._over & ~terminated, self._flag(after, "failed"))
        return Step(self._seen()[ids], reward[ids], *(flag[ids] for flag in ends))

    def _seen(self) -> np.ndarray:
        seen: torch.Tensor = self._now["observation"]
        return np.asarray(seen.cpu(), np.float64)

    def _flag(self, data: TensorDictBase, name: str) -> np.ndarray:
        """Return a flag of each row, (N,); one that is not there is not set."""
        found = data.get(name, None)
        if found is None:
            return np.zeros(self.num_rows, bool)
        return found.reshape(self.num_rows).cpu().numpy()

    def _begin(self) -> TensorDictBase:
        try:
            return self._env.reset(seeds=self._seeds.copy())
        except TypeError as error:
            raise Sim2RealError(
                f"env: a population restarts rows with separate seeds, but "
                f"{type(self._env.base_env).__name__} takes none ({error}); let its _reset take "
                "seeds, (N,) uint64"
            ) from error

    def _restart(self, ids: np.ndarray) -> None:
        mask = torch.zeros((self.num_rows, 1), dtype=torch.bool)
        mask[torch.from_numpy(ids)] = True
        self._given.values = dict(zip(self.space.names, self._values.T, strict=True))
        now = self._now.clone().set("_reset", mask.to(self._env.device or "cpu"))
        self._now = self._env.reset(now, seeds=self._seeds.copy())
        self._over[ids] = False

    def _try(self) -> None:
        """Play the same steps twice, in between restarting every other row."""
        others = self._ids[1::2]
        kept = self._ids[::2]
        first, second = self._play(kept, np.empty(0, np.int64)), self._play(kept, others)
        if np.array_equal(first, second, equal_nan=True):
            return
        chain: Any = self._env.transform
        names = ", ".join(type(one).__name__ for one in chain if one is not self._given)
        raise Sim2RealError(
            "in a population, an episode must depend only on its robot, seed and actions, but a "
            f"repetition differed: {type(self._env.base_env).__name__} with the transforms "
            f"{names or 'none'}; remove transforms that keep statistics (for observations set "
            "algorithm.normalize_observations=true), and let a reset start the rows of the mask "
            "'_reset' alone, each by its entry of seeds"
        )

    def _play(self, kept: np.ndarray, restarted: np.ndarray) -> np.ndarray:
        """Return some rows' observations and rewards in a few steps while others restart."""
        seeds, points = self._ids.astype(np.uint64), self.space.points(self.num_rows)
        rng = np.random.default_rng(0)  # any actions do, if they are the same twice
        said = [self.reset(self._ids, points, seeds)[kept].ravel()]
        for number in range(1, TRIED):
            action = rng.standard_normal((self.num_rows, self.action_size))
            step = self.step(None, np.clip(action, self.action_low, self.action_high))
            said += [step.observation[kept].ravel(), step.reward[kept]]
            if len(restarted):
                self.reset(restarted, points[restarted], seeds[restarted] + np.uint64(number))
        return np.concatenate(said)


class _GivenParams(Transform):
    """Hands an environment the parameters of its rows at each reset."""

    def __init__(self) -> None:
        super().__init__()
        self.values: dict[str, np.ndarray] = {}  # (N,) each

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase | None:
        env = self.parent
        if env is None or not self.values:
            return tensordict
        given = {}
        for name, column in self.values.items():
            spec = env.base_env.full_observation_spec["params", name]
            given[name] = torch.as_tensor(column, dtype=spec.dtype).reshape(spec.shape)
        params = TensorDict({"params": given}, env.batch_size, device=env.device)
        return params if tensordict is None else tensordict.update(params)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return tensordict_reset

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict


def _space(env: TransformedEnv, now: TensorDictBase) -> ParamSpace:
    """Return the parameters; those of a third-party environment are neutral at its start."""
    base = env.base_env
    if isinstance(base, RowsEnv):
        return base.rows.space
    params = now.get("params", None)
    if params is None:
        return ParamSpace()
    neutral = {str(name): float(value.reshape(-1)[0]) for name, value in params.items()}
    return ParamSpace([Parameter(name, name, neutral=value) for name, value in neutral.items()])
