"""Any `Rows` as a TorchRL environment of batch size (N,).

    env = TransformedEnv(RowsEnv(simulation), RandomizeParams(tasks))
    rollout = env.rollout(1000, policy, break_when_any_done=False)
    rollout["params", "link_mass.torso"]                # (N, T): each step knows its robot

Rows that end are reset by mask while the others go on, as TorchRL's collectors do by themselves.
Parameters travel in the tensordict under ("params", name): at a reset the environment writes those
that it is given into the rows that reset, and keeps the rest. Actions are cut at their limits,
unless `cut=False`.

    env.reset(values=values, seeds=seeds)               # these robots (N, P), with these seeds (N,)
    state = env.episodes()                              # the episodes in progress, as plain data
    env.resume(state)                                   # ... played again, to the last bit
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase, Transform

from envs.errors import ParameterError, TaskError
from envs.params import ParamSpace
from envs.physics.arrays import Array
from envs.randomization import Tasks
from envs.rows import Rows, arrays_of


class RowsEnv(EnvBase):
    """A TorchRL environment over rows.

    Args:
        rows: the world; its N rows are the batch.
        device: where tensors go; the rows themselves may be elsewhere.
        dtype: the dtype of observations, actions and rewards.
        seed: the seed of the episodes; `set_seed` changes it.
        tasks: draws the parameters, as `RandomizeParams` does, but faster: an environment without
            transforms restarts its rows without TorchRL's general machinery.
        cut: whether actions are cut at their limits before the rows take them.

    Attributes:
        rewards: of the last step, (N,) float64, as the rows paid them.

    Raises:
        ParameterError: tasks that do not fit the rows' parameters.
    """

    def __init__(
        self,
        rows: Rows,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        seed: int = 0,
        tasks: Tasks | None = None,
        cut: bool = True,
    ) -> None:
        super().__init__(device=device, batch_size=torch.Size([rows.num_rows]))
        self.rows, self._float = rows, dtype
        self._values = rows.space.points(rows.num_rows)  # (N, P)
        self._params = self._params_tensordict()
        count = rows.num_rows
        self._arrays = arrays = arrays_of(rows)
        self._last = arrays.zeros((count, rows.observation_size))  # (N, O), the newest observations
        self._ids = np.arange(count)
        self._seeds = np.zeros(count, np.uint64)
        self._ages = np.zeros(count, np.int64)  # steps of the episode so far
        self._places = arrays.own(self._ids), arrays.own(self._ages)  # where the rows have them
        self._actions = arrays.zeros((0, count, rows.action_size))  # of the episodes so far
        free = np.full(rows.action_size, np.inf)
        limits = (rows.action_low, rows.action_high) if cut else (-free, free)
        self._low, self._high = map(arrays.own, limits)
        self.rewards: Array = np.zeros(count)
        self._make_specs()
        self._set_seed(seed)
        self.tasks: Tasks | None = None
        if tasks is not None:
            self.randomize(tasks)

    def randomize(self, tasks: Tasks) -> None:
        """Draw the parameters of coming episodes from tasks; raises ParameterError if none fit."""
        tasks.check(self.rows.space)
        self.tasks, self._drawn = tasks, np.zeros(self.rows.num_rows, dtype=bool)

    def _make_specs(self) -> None:
        n, rows = self.batch_size[0], self.rows
        seen, acted = torch.Size((n, rows.observation_size)), torch.Size((n, rows.action_size))
        one, each = torch.Size((n, 1)), torch.Size((n,))
        flag = Binary(n=1, shape=one, dtype=torch.bool, device=self.device)
        value = Unbounded(each, dtype=torch.float64, device=self.device)
        self.observation_spec = Composite(
            observation=Unbounded(seen, dtype=self._float, device=self.device),
            failed=flag.clone(),
            params=Composite({name: value.clone() for name in rows.space.names}, shape=each),
            shape=each,
        )
        low, high = (
            torch.as_tensor(x, dtype=self._float, device=self.device).expand(acted)
            for x in (rows.action_low, rows.action_high)
        )
        self.action_spec = Bounded(low, high, acted, device=self.device, dtype=self._float)
        self.reward_spec = Unbounded(one, dtype=self._float, device=self.device)
        self.full_done_spec = Composite(
            done=flag, terminated=flag.clone(), truncated=flag.clone(), shape=each
        )

    def _set_seed(self, seed: int | None) -> None:
        self.rng = np.random.default_rng(seed)
        self._drawn = np.zeros(self.rows.num_rows, dtype=bool)  # (N,): rows that keep a draw

    def _reset(
        self,
        tensordict: TensorDictBase | None = None,
        *,
        values: np.ndarray | None = None,
        seeds: np.ndarray | None = None,
        **others: object,
    ) -> TensorDictBase:
        """Start episodes; `values` (N, P) and `seeds` (N,) decide them instead of draws."""
        mask = None if tensordict is None else tensordict.get("_reset", None)
        ids = self._ids if mask is None else _where(mask)
        given = None if tensordict is None else tensordict.get("params", None)
        if values is not None:
            self._values[ids] = values[ids]
        elif given is not None and self.rows.space.size:
            columns = [given[name].reshape(-1).cpu().numpy() for name in self.rows.space.names]
            self._values[ids] = np.stack(columns, axis=1)[ids]
        else:
            self._draw(ids)
        return self._tensordict(self._start(ids, None if seeds is None else seeds[ids]))

    def maybe_reset(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Restart the rows that are done and put what changed into the tensordict.

        What TorchRL does by a masked merge of every entry, for an environment without transforms.
        """
        done = tensordict.get("done", None)
        if done is None or tensordict.get("_reset", None) is not None:
            return super().maybe_reset(tensordict)
        ids = _where(done)
        if len(ids):
            self._draw(ids)
            tensordict.update(self._tensordict(self._start(ids)))
        return tensordict

    def _start(self, ids: np.ndarray, seeds: np.ndarray | None = None) -> dict[str, torch.Tensor]:
        """Start episodes in the rows ids (n,); return the entries of all rows after that."""
        if self.rows.space.size:  # a new one: what was returned before belongs to the caller
            self._params = self._params_tensordict()
        if seeds is None:
            seeds = self.rng.integers(0, 2**63, len(ids)).astype(np.uint64)
        self._seeds[ids], self._ages[ids] = seeds, 0
        self._places[1][self._arrays.rows(ids)] = 0
        # the rows that go on keep what they saw
        self._last = self._arrays.xp.asarray(self._last, copy=True)
        seen = self.rows.reset(ids, self._values[ids], self._seeds[ids])
        self._last[self._arrays.rows(ids)] = seen
        no = torch.zeros((self.rows.num_rows, 1), dtype=torch.bool, device=self.device)
        flags = {"done": no.clone(), "terminated": no.clone(), "truncated": no.clone()}
        return {**self._seen(ids), "failed": no, **flags}

    def _seen(self, ids: np.ndarray | None) -> dict[str, torch.Tensor]:
        """Return every row's observation, after the rows ids (None: all) moved or started."""
        return {"observation": self._tensor(self._last, self._float)}

    def _draw(self, ids: np.ndarray) -> None:
        if self.tasks is None:
            return
        if self.tasks.per == "row":
            ids = ids[~self._drawn[ids]]
        if len(ids):
            self._values[ids] = self.tasks.sample(self.rng, len(ids))
            self._drawn[ids] = True

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = self.taken(tensordict)
        step = self.rows.step(None, action)
        self._note(action)
        self._last, self.rewards = step.observation, step.reward
        return self._tensordict(
            {
                **self._seen(None),
                "reward": self._tensor(step.reward[:, None], self._float),
                "done": self._tensor((step.terminated | step.truncated)[:, None], torch.bool),
                "terminated": self._tensor(step.terminated[:, None], torch.bool),
                "truncated": self._tensor(step.truncated[:, None], torch.bool),
                "failed": self._tensor(step.failed[:, None], torch.bool),
            }
        )

    def taken(self, tensordict: TensorDictBase) -> Array:
        """Return the actions that the rows take of an entry "action" (N, A); NaN stays, and fails.

        They are float64 on the host.
        """
        action = tensordict.get("action").detach()
        if self._arrays.on_host:
            taken = action.cpu().numpy().astype(np.float64)
            return np.minimum(np.maximum(taken, self._low), self._high)
        taken = action.to(self._arrays.device, self._arrays.dtype)
        return torch.minimum(torch.maximum(taken, self._low), self._high)

    def _note(self, action: Array) -> None:
        """Keep the actions (N, A) of the episodes in progress."""
        if self._ages.max() >= len(self._actions):
            room = self._arrays.zeros((max(32, len(self._actions)), *action.shape))
            self._actions = self._arrays.xp.concat([self._actions, room])
        ids, ages = self._places
        self._actions[ages, ids] = action
        self._ages += 1
        if ages is not self._ages:  # on a device, which is not waited for
            ages += 1

    def episodes(self) -> dict[str, Any]:
        """Return the episodes in progress and the generator of what follows, as plain data."""
        longest = int(self._ages.max())
        now = np.arange(longest)[:, None] < self._ages  # (T, N); else left from episodes before
        return {
            "rng": self.rng.bit_generator.state,
            "values": self._values.copy(),
            "drawn": self._drawn.copy(),
            "seeds": self._seeds.copy(),
            "ages": self._ages.copy(),
            "actions": np.where(now[:, :, None], self._arrays.host(self._actions[:longest]), 0.0),
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go back to `episodes()`, playing those in progress again: they are pure functions.

        Raises:
            TaskError: a state of another number of rows.
        """
        there, here = len(state["seeds"]), self.rows.num_rows
        if there != here:
            raise TaskError(f"the episodes have {there} rows, but this environment has {here}")
        if self.tasks is not None:
            self.tasks.check(self.rows.space)
        self.rng.bit_generator.state = state["rng"]
        for own, name in ((self._values, "values"), (self._drawn, "drawn"), (self._seeds, "seeds")):
            own[:] = state[name]
        self._start(self._ids, self._seeds.copy())
        self._ages[:], self._actions = state["ages"], self._arrays.own(np.array(state["actions"]))
        self._places[1][:] = self._arrays.own(self._ages)
        for age, action in enumerate(self._actions):
            ids = np.flatnonzero(self._ages > age)
            rows = self._arrays.rows(ids)
            self._last[rows] = self.rows.step(ids, action[rows]).observation
        self._seen(None)

    def _tensor(self, array: Array, dtype: torch.dtype) -> torch.Tensor:
        own = torch.from_numpy(array) if isinstance(array, np.ndarray) else array
        return own.to(self.device, dtype, copy=True)  # the rows may reuse theirs

    def _tensordict(self, data: dict[str, torch.Tensor]) -> TensorDictBase:
        data["params"] = self._params  # type: ignore[assignment]
        return self._wrap(data)

    def _params_tensordict(self) -> TensorDictBase:
        columns = self._tensor(self._values.T, torch.float64)  # (P, N)
        return self._wrap(dict(zip(self.rows.space.names, columns.unbind(0), strict=True)))

    def _wrap(self, data: dict[str, torch.Tensor]) -> TensorDictBase:
        """Return a TensorDict without its constructor's checks, which cost much here."""
        return TensorDict._new_unsafe(data, batch_size=self.batch_size, device=self.device)  # type: ignore[arg-type]


class RandomizeParams(Transform):
    """Gives each episode its parameters, drawn from a task distribution.

    Args:
        tasks: the distribution; its `per` ("reset" or "row") says how long a row keeps its draw.

    A `RowsEnv` draws by itself, from its own generator, so that `set_seed` decides the draws too.
    Any other environment with entries ("params", name) is handed them with each reset. Where
    the tasks draw nothing, any environment is left as it is.

    Raises:
        ParameterError: at the first reset, tasks that do not fit the environment's parameters.
        TaskError: at a reset, an environment without parameters to draw.
    """

    def __init__(self, tasks: Tasks) -> None:
        super().__init__()
        self.tasks = tasks
        self._rng = np.random.default_rng(0)

    def set_seed(self, seed: int | None) -> None:
        """Decide the draws of an environment that does not draw by itself."""
        self._rng = np.random.default_rng(seed)

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase | None:
        parent = self.parent
        env = None if parent is None else parent.base_env
        if not isinstance(env, RowsEnv):
            return self._handed(env, tensordict)
        if env.tasks is not self.tasks:
            env.randomize(self.tasks)
        return tensordict

    def _handed(
        self, env: EnvBase | None, tensordict: TensorDictBase | None
    ) -> TensorDictBase | None:
        """Return the reset's tensordict with draws, for a third-party environment."""
        if env is None or "params" not in env.observation_spec:
            if env is not None and _draws_nothing(self.tasks):
                return tensordict
            raise TaskError(
                f"RandomizeParams draws for an environment with entries ('params', name), which "
                f"{'nothing' if env is None else type(env).__name__} has not; put it into a "
                "TransformedEnv over a MujocoEnv, or leave it out"
            )
        names = list(map(str, env.observation_spec["params"].keys()))
        try:
            values = self.tasks.sample(self._rng, max(1, env.batch_size.numel()))  # (N, P)
        except ParameterError as error:
            raise TaskError(
                f"RandomizeParams: these tasks draw effects of a simulated robot, which "
                f"{type(env).__name__} has not; its parameters are: {', '.join(names)}"
            ) from error
        if values.shape[1] != len(names):
            raise TaskError(
                f"the tasks draw {values.shape[1]} parameters, {type(env).__name__} has "
                f"{len(names)}: {', '.join(names)}"
            )
        drawn = {}
        for name, column in zip(names, values.T, strict=True):
            spec = env.observation_spec["params", name]
            drawn[name] = torch.as_tensor(column, dtype=spec.dtype).reshape(spec.shape)
        given = TensorDict({"params": drawn}, env.batch_size, device=env.device)
        return given if tensordict is None else tensordict.update(given)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return tensordict_reset

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict


def _draws_nothing(tasks: Tasks) -> bool:
    """Return whether tasks fit a world without parameters."""
    try:
        tasks.check(ParamSpace(()))
    except ParameterError:
        return False
    return True


def _where(mask: torch.Tensor) -> np.ndarray:
    return np.flatnonzero(mask.reshape(-1).cpu().numpy())
