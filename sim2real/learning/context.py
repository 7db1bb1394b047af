"""Condition a policy on its robot's physical parameters.

    env = make_env(compose(["+experiment=es_dr", "transforms=with_params"]), num_envs=256)
    env.reset()["observation"]                  # (256, O + P): the last P are the robot's own

In simulation the policy receives the true parameters: it is an oracle. On a real robot they are
unknown, so it receives the centre of the training range until `adapt=identify` has estimated them.

Each parameter is mapped from its training range to [-1, 1]. With `products` the observation times
each parameter is appended, too: the gains of a linear policy then depend on the robot, as those of
a gain-scheduled controller do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.data import Composite, Unbounded
from torchrl.envs import Transform, TransformedEnv

from envs.distribution import Distribution
from envs.params import Parameter, ParamSpace
from envs.physics.arrays import Array
from envs.randomization import Tasks
from envs.rows import Rows, Step, arrays_of
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
NORMAL = 2.0  # standard deviations of a law without ends that count as its range: 95 %


def training_range(tasks: Any, space: ParamSpace) -> dict[str, tuple[float, float]]:
    """Return the range that a task distribution draws each parameter from.

    Of a normal law without limits it is mean ± 2 standard deviations. Tasks of other kinds than
    `Randomization` and `Distribution` have no known range: {}.
    """
    if isinstance(tasks, Distribution):
        wide = NORMAL * tasks.std
        low, high = (
            np.maximum(tasks.low, tasks.mean - wide),
            np.minimum(tasks.high, tasks.mean + wide),
        )
        return dict(zip(tasks.names, zip(low.tolist(), high.tolist(), strict=True), strict=True))
    found: dict[str, tuple[float, float]] = {}
    for draw in getattr(tasks, "draws", ()):
        low, high = draw.reach
        if draw.distribution == "normal":
            low, high = draw.mean - NORMAL * draw.std, draw.mean + NORMAL * draw.std
        place = (draw.effect.name, draw.effect.where, draw.effect.side)
        for p in space.parameters:
            if (p.effect, p.where, p.side) == place:
                found[p.name] = (float(low), float(high))
    return found


@dataclass(frozen=True, eq=False)
class ContextSpec:
    """Which parameters a policy receives, and over which ranges."""

    parameters: tuple[Parameter, ...]  # P of them, in the order of the simulator's space
    # lower ends of the ranges that training draws them from, (P,), each in its unit
    low: np.ndarray
    high: np.ndarray  # upper ends, (P,)

    @classmethod
    def from_tasks(cls, tasks: Tasks, space: ParamSpace) -> ContextSpec:
        """Return the parameters that tasks draw, with their ranges.

        Raises:
            Sim2RealError: tasks that draw nothing, have no known range, or one without width.
        """
        ranges = training_range(tasks, space)
        lacking = [name for name in space.names if name not in ranges]
        if not space.size or lacking:
            raise Sim2RealError(
                "transforms=with_params needs parameters with known ranges: "
                + (
                    f"{lacking[0]} has none; give it low and high in params"
                    if lacking
                    else "params draws nothing; choose params=NAME, such as params=mass_friction"
                )
            )
        low, high = np.array([ranges[name] for name in space.names]).T
        for name, least, most in zip(space.names, low, high, strict=True):
            if not most > least:
                raise Sim2RealError(
                    f"transforms=with_params: every robot in training has {name} = {least:g}, "
                    "so a policy cannot learn what it means; widen its range in params, or leave "
                    "it out"
                )
        return cls(space.parameters, low, high)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, P of them."""
        return tuple(p.name for p in self.parameters)

    @property
    def size(self) -> int:
        """P."""
        return len(self.parameters)

    @property
    def center(self) -> np.ndarray:
        """The middles of the ranges, (P,), each in its unit."""
        return (self.low + self.high) / 2

    @property
    def half_range(self) -> np.ndarray:
        """Half the widths of the ranges, (P,), each in its unit."""
        return (self.high - self.low) / 2

    def normalize(self, values: np.ndarray, limit: float) -> np.ndarray:
        """Map values (..., P) from the training ranges to [-1, 1], clipped to ± limit."""
        return np.clip((values - self.center) / self.half_range, -limit, limit)


class AppendContext(Transform):
    """Appends the robot's parameters to "observation".

    Args:
        context: which parameters, and over which ranges.
        limit: where normalized parameters are clipped, in halves of the training range: at 1 a
            robot outside the range looks like the nearest one inside.
        products: whether the observation times each parameter follows, P times O numbers.
        truth: whether simulation supplies the true parameters; false supplies the centre, as for a
            robot that was not identified.

    Attributes:
        assumed_context: used instead of the truth, (N, P) or (P,), -1 to 1 over the ranges. None
            uses the truth, or the centre where the robot has no ("params", name).

    Raises:
        Sim2RealError: a limit below 1.
    """

    def __init__(
        self, context: ContextSpec, limit: float = 1.0, products: bool = False, truth: bool = True
    ) -> None:
        if not limit >= 1:
            raise Sim2RealError(f"transforms.with_params.limit={limit} must be at least 1")
        super().__init__(in_keys=["observation"], out_keys=["observation"])
        self.context, self.limit, self.products, self.truth = context, limit, products, truth
        self.assumed_context: np.ndarray | None = None
        self._middle, self._half = (
            torch.from_numpy(x) for x in (context.center, context.half_range)
        )

    def affine(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the offset and the scale of parameters: (value - offset) / scale."""
        return self.context.center, self.context.half_range

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        seen = next_tensordict.get("observation")
        said = self._said(next_tensordict, seen).to(seen.device, seen.dtype)
        parts = [seen, said]
        if self.products:
            parts += [seen * one[..., None] for one in said.unbind(-1)]
        return next_tensordict.set("observation", torch.cat(parts, -1))

    def _said(self, tensordict: TensorDictBase, seen: Tensor) -> Tensor:
        shape = (*seen.shape[:-1], self.context.size)
        if self.assumed_context is not None:
            return torch.as_tensor(self.assumed_context).expand(shape)
        params = tensordict.get("params", None) if self.truth else None
        there = {} if params is None else dict(params.items())
        values = self._middle.expand(shape).clone()
        for column, name in enumerate(self.context.names):
            if name in there:
                values[..., column] = there[name].reshape(shape[:-1])
        return ((values - self._middle) / self._half).clamp_(-self.limit, self.limit)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        return self._call(tensordict_reset)

    def output_size(self, size: int) -> int:
        """Return how long an observation of O numbers becomes."""
        return size + self.context.size * (1 + self.products * size)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Return the specs with a longer observation."""
        old = observation_spec["observation"]
        shape = torch.Size((*old.shape[:-1], self.output_size(old.shape[-1])))
        observation_spec["observation"] = Unbounded(shape, dtype=old.dtype, device=old.device)
        return observation_spec


def set_assumed_context(env: TransformedEnv, said: np.ndarray | None) -> None:
    """Override the context that the policies of an environment receive.

    Args:
        env: has `AppendContext` transforms; without one nothing changes.
        said: -1 to 1 over the ranges, (N, P), or (P,) for all rows; None restores the truth.
    """
    chain: Any = env.transform
    for one in chain:
        if isinstance(one, AppendContext):
            one.assumed_context = None if said is None else np.clip(said, -one.limit, one.limit)


class ContextRows:
    """Rows that show their parameters behind their observations, as `AppendContext` does.

    Args:
        rows: the world.
        transform: says which parameters, and how.
    """

    def __init__(self, rows: Rows, transform: AppendContext) -> None:
        self._rows, self._transform = rows, transform
        self.num_rows, self.max_steps, self.space = rows.num_rows, rows.max_steps, rows.space
        self.action_low, self.action_high = rows.action_low, rows.action_high
        self.action_size = rows.action_size
        self.observation_size = transform.output_size(rows.observation_size)
        self.arrays = arrays_of(rows)
        self._said = self.arrays.zeros((rows.num_rows, transform.context.size))

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> Array:
        """Start an episode in each of the rows ids (n,); see `Rows`."""
        context, rows = self._transform.context, self.arrays.rows(ids)
        true = self._transform.truth
        known = values if true else np.tile(context.center, (len(ids), 1))
        self._said[rows] = self.arrays.own(context.normalize(known, self._transform.limit))
        return self._longer(self._rows.reset(ids, values, seeds), self._said[rows])

    def step(self, ids: np.ndarray | None, action: Array) -> Step:
        """Advance the rows ids (None: all of them) by one control step; see `Rows`."""
        step = self._rows.step(ids, action)
        said = self._said[self.arrays.rows(ids)]
        return step._replace(observation=self._longer(step.observation, said))

    def _longer(self, seen: Array, said: Array) -> Array:
        parts = [seen, said]
        if self._transform.products:
            parts += [seen * one[:, None] for one in said.T]
        return self.arrays.xp.concat(parts, axis=1)
