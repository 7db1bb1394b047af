"""Episodes of several tasks side by side, each task with its own parameters.

    tasks = TaskBatch(parts.tasks, each=20)             # rows 0 ... 19 meet one task, and so on
    actor = TaskActor(law, count=40)                    # for 40 tasks
    actor.thetas = adapted                              # (40, P); or (P,), the same for all
    actor(tensordict)                                   # (800,) rows

`TaskBatch` is a distribution that `RandomizeParams` draws from; a row keeps its task until the
environment draws its robots again (`RowsEnv.randomize`).
"""

from typing import Any, Literal

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch.func import vmap
from torchrl.envs.utils import ExplorationType, exploration_type

from envs.params import ParamSpace
from envs.randomization import Tasks
from sim2real.learning.modules.functional_actor import FunctionalActor, log_prob
from sim2real.runs.errors import Sim2RealError


class TaskBatch:
    """A task distribution whose draws are held by as many rows each.

    Args:
        tasks: the distribution.
        each: rows that share a task.
    """

    per: Literal["reset", "row"] = "row"

    def __init__(self, tasks: Tasks, each: int) -> None:
        self.tasks, self._each = tasks, each
        self.effects = tasks.effects

    def check(self, space: ParamSpace) -> None:
        """Raise ParameterError if the tasks do not fit a space; see `Tasks.check`."""
        self.tasks.check(space)

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw for n rows, (n, P); different tasks, where there are so few that they can be named.

        Raises:
            Sim2RealError: n that is no multiple of the rows of a task, or more tasks than there
                are.
        """
        if n % self._each:
            raise Sim2RealError(f"{n} rows cannot share tasks by {self._each}")
        count = n // self._each
        check_batch(self.tasks, count)
        distinct: np.ndarray | None = getattr(self.tasks, "distinct", None)
        if distinct is None:
            drawn = self.tasks.sample(rng, count)
        else:
            drawn = distinct[rng.permutation(len(distinct))[:count]]
        return np.repeat(drawn, self._each, axis=0)


def check_batch(tasks: Tasks, count: int) -> None:
    """Raise Sim2RealError for a batch of more tasks than a distribution has."""
    distinct: np.ndarray | None = getattr(tasks, "distinct", None)
    if distinct is not None and count > len(distinct):
        raise Sim2RealError(
            f"algorithm.task_batch={count} is more than the {len(distinct)} tasks of "
            f"{type(tasks).__name__}; set algorithm.task_batch={len(distinct)} or less"
        )


class TaskActor(TensorDictModuleBase):
    """An actor whose parameters differ between groups of rows.

    Args:
        law: of the actor.
        count: B, groups of as many rows each.

    Attributes:
        thetas: the parameters, (B, P), or (P,) for all.
    """

    def __init__(self, law: FunctionalActor, count: int) -> None:
        super().__init__()
        self.in_keys: list[Any] = law.in_keys
        self.out_keys: list[Any] = ["loc", "scale", "action", "action_log_prob"]
        self._law, self._count = law, count
        self.thetas = law.vector()

    @torch.no_grad()
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the law, the action and its log-density into rows (B M,)."""
        seen = self._law.read(tensordict)
        if self.thetas.ndim == 1:
            loc, log_scale = self._law(self.thetas, *seen)
        else:
            grouped = [x.unflatten(0, (self._count, -1)) for x in seen]
            found = vmap(self._law)(self.thetas, *grouped)
            loc, log_scale = (x.flatten(0, 1) for x in found)
        scale, action = log_scale.exp(), loc
        if exploration_type() is ExplorationType.RANDOM:
            action = loc + torch.randn_like(loc) * scale
        values = loc, scale, action, log_prob((loc, log_scale), action)
        return tensordict.update(dict(zip(self.out_keys, values, strict=True)))
