"""Any `Rows` as a TorchRL environment of batch size (N,).

    env = TransformedEnv(RowsEnv(simulation), RandomizeParams(tasks))
    rollout = env.rollout(1000, policy, break_when_any_done=False)
    rollout["params", "link_mass.torso"]                # (N, T): each step knows its robot

Rows that end are reset by mask while the others go on, as TorchRL's collectors do by themselves. Parameters travel in
the tensordict under ("params", name): at a reset the environment writes those that it is given into the rows that
reset, and keeps the rest.
"""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase, Transform

from envs.randomization import Tasks
from envs.rows import Rows


class RowsEnv(EnvBase):
    """A TorchRL environment over rows.

    Args:
        rows: the world; its N rows are the batch.
        device: where tensors go; the simulation itself runs on the CPU.
        dtype: of observations, actions and rewards.
        seed: of the episodes; `set_seed` changes it.
    """

    def __init__(
        self,
        rows: Rows,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        seed: int = 0,
    ) -> None:
        super().__init__(device=device, batch_size=[rows.num_rows])
        self.rows, self._float = rows, dtype
        self._values = rows.space.points(rows.num_rows)  # (N, P)
        self._params = self._params_tensordict()
        self._last = np.zeros((rows.num_rows, rows.observation_size))  # (N, O), the newest observations
        self._make_specs()
        self._set_seed(seed)

    def _make_specs(self) -> None:
        n, rows = self.batch_size[0], self.rows
        params = Composite(
            {name: Unbounded((n,), dtype=torch.float64, device=self.device) for name in rows.space.names}, shape=(n,)
        )
        self.observation_spec = Composite(
            observation=Unbounded((n, rows.observation_size), dtype=self._float, device=self.device),
            failed=Binary(n=1, shape=(n, 1), dtype=torch.bool, device=self.device),
            params=params,
            shape=(n,),
        )
        low, high = (torch.as_tensor(x, dtype=self._float).expand(n, -1) for x in (rows.action_low, rows.action_high))
        self.action_spec = Bounded(low, high, (n, rows.action_size), device=self.device, dtype=self._float)
        self.reward_spec = Unbounded((n, 1), dtype=self._float, device=self.device)
        flag = Binary(n=1, shape=(n, 1), dtype=torch.bool, device=self.device)
        self.full_done_spec = Composite(done=flag, terminated=flag.clone(), truncated=flag.clone(), shape=(n,))

    def _set_seed(self, seed: int | None) -> None:
        self.rng = np.random.default_rng(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: object) -> TensorDictBase:
        n = self.batch_size[0]
        mask = None if tensordict is None else tensordict.get("_reset", None)
        ids = np.arange(n) if mask is None else np.flatnonzero(mask.reshape(n).cpu().numpy())
        if tensordict is not None and "params" in tensordict.keys() and self.rows.space.size:
            given = [tensordict["params", name].reshape(n).cpu().numpy() for name in self.rows.space.names]
            self._values[ids] = np.stack(given, axis=1)[ids]
            self._params = self._params_tensordict()
        seeds = self.rng.integers(0, 2**63, len(ids)).astype(np.uint64)
        self._last = self._last.copy()  # the rows that go on keep what they saw
        self._last[ids] = self.rows.reset(ids, self._values[ids], seeds)
        observation = torch.as_tensor(self._last, dtype=self._float, device=self.device)
        no = torch.zeros((n, 1), dtype=torch.bool, device=self.device)
        flags = {"failed": no, "done": no.clone(), "terminated": no.clone(), "truncated": no.clone()}
        return self._tensordict({"observation": observation, **flags})

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        step = self.rows.step(None, tensordict["action"].cpu().numpy().astype(np.float64))
        self._last = step.observation
        terminated, truncated, failed = (self._tensor(x) for x in (step.terminated, step.truncated, step.failed))
        return self._tensordict(
            {
                "observation": torch.as_tensor(self._last, dtype=self._float, device=self.device),
                "reward": torch.as_tensor(step.reward[:, None], dtype=self._float, device=self.device),
                "done": terminated | truncated,
                "terminated": terminated,
                "truncated": truncated,
                "failed": failed,
            }
        )

    def _tensor(self, flag: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(flag[:, None], device=self.device)  # (N, 1)

    def _tensordict(self, data: dict[str, torch.Tensor]) -> TensorDictBase:
        data["params"] = self._params  # type: ignore[assignment]
        return TensorDict(data, batch_size=self.batch_size, device=self.device)  # type: ignore[arg-type]

    def _params_tensordict(self) -> TensorDictBase:
        names, n = self.rows.space.names, self.rows.num_rows
        columns = torch.as_tensor(self._values.T.copy(), device=self.device)  # (P, N)
        return TensorDict(dict(zip(names, columns, strict=True)), batch_size=[n], device=self.device)


class RandomizeParams(Transform):
    """Gives each episode its parameters, drawn from a task distribution.

    Args:
        tasks: the distribution; its `per` ("reset" or "row") says how long a row keeps its draw.

    The draws come from the environment's own generator, so that `set_seed` decides them too.
    """

    def __init__(self, tasks: Tasks) -> None:
        super().__init__()
        self.tasks = tasks
        self._kept: np.ndarray | None = None

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        env = self.parent.base_env  # type: ignore[union-attr]
        n = env.batch_size[0]
        if self._kept is None:
            self.tasks.check(env.rows.space)
        if self._kept is None or getattr(self.tasks, "per", "reset") == "reset":
            self._kept = self.tasks.sample(env.rng, n)
        if tensordict is None:
            tensordict = TensorDict({}, batch_size=env.batch_size, device=env.device)
        columns = torch.as_tensor(self._kept.T.copy(), device=env.device)  # (P, N)
        params = TensorDict(dict(zip(env.rows.space.names, columns, strict=True)), batch_size=[n], device=env.device)
        return tensordict.set("params", params)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return tensordict_reset

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict
