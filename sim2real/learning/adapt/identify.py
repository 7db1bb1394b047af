"""Identification: estimate the robot's parameters and condition the policy on them.

    operator = Identify(episodes=3, last=3, find=find).bind_environment(trained.environment)
    session = operator.start(theta, rng)
    while (candidate := session.ask()) is not None:  # theta, then the assumed context
        value, log = run_one_episode(candidate)
        session.tell(value, log=log)
    session.found                                   # (P,): the robot's parameters, in their units

The policy is conditioned on its robot's parameters (`sim2real.learning.context`). It begins with
the centre of their ranges. After each episode they are identified from the logs of the last
episodes, and the next episode runs with the estimate. Returns have no influence.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from copy import copy
from typing import Any, ClassVar, Protocol

import numpy as np
import torch

from hardware.log import Log
from sim2real.learning.adapt.base import (
    Adaptation,
    BatchedSession,
    EpisodeTrajectory,
    Session,
    check_budget,
)
from sim2real.learning.context import ContextSpec
from sim2real.runs.errors import Sim2RealError

META = "meta"  # a log's metadata, as JSON in bytes


class ParameterEstimator(Protocol):
    """Finds a robot's parameters in its logs; see `identification.episodes.EpisodeIdentifier`."""

    def __call__(self, environment: Any, logs: Sequence[Log], seed: int) -> np.ndarray:
        """Return the parameters (P,) that an environment draws, each in its unit.

        Args:
            environment: has the `task`, the `tasks` that say where values may be, and the `fixed`
                effects.
            logs: of one robot, an episode each.
            seed: of all that is random.
        """
        ...


class Identify(Adaptation):
    """Conditions the policy on the parameters identified from its last episodes' logs.

    Args:
        episodes: how many the adaptation spends.
        last: how many logs, the newest, are identified together.
        find: how.
        budget: episodes that it must spend in all; None for `episodes`.

    Raises:
        Sim2RealError: numbers below 1, or a budget that does not fit.
    """

    needs_log: ClassVar[bool] = True

    def __init__(
        self, *, episodes: int, last: int, find: ParameterEstimator, budget: int | None = None
    ) -> None:
        if episodes < 1 or last < 1:
            raise Sim2RealError(f"adapt: episodes={episodes} and last={last} must be at least 1")
        self._count, self.last, self._find = episodes, last, find
        self._environment: Any = None
        self.context_spec: ContextSpec | None = None
        check_budget(self, budget, f"give adapt.episodes={budget}")

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return f"identification from the last {self.last} of {self._count} episodes"

    @property
    def stages(self) -> tuple[int, ...]:
        """One episode each."""
        return (1,) * self._count

    @property
    def queries(self) -> int:
        """None."""
        return 0

    def bind_environment(self, environment: Any) -> Identify:
        """Return this for a policy of an environment.

        Raises:
            Sim2RealError: an environment whose policies do not receive their robot's parameters.
        """
        spec = environment.context_spec
        if spec is None:
            raise Sim2RealError(
                "adapt=identify needs a policy that receives its robot's parameters, but this one "
                "was trained without them. Train one with transforms=with_params (PPO: "
                "transforms=normalized_with_params), or choose another adapt"
            )
        other = copy(self)
        other.context_spec, other._environment = spec, environment
        return other

    def find(self, logs: Sequence[Log], seed: int) -> np.ndarray:
        """Return the robot's parameters, (P,), each in its unit."""
        found = self._find(self._environment, logs, seed)
        if not np.isfinite(found).all():
            raise Sim2RealError(f"adaptation: {self} found {found}, which are not finite numbers")
        return found

    def start(self, theta: np.ndarray, rng: np.random.Generator) -> IdentifySession:
        """Start one adaptation that asks for one episode at a time; see `Adaptation`."""
        return IdentifySession(self, theta, int(rng.integers(2**31)))

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> BatchedSession:
        """Refuse: a population reports returns alone.

        Raises:
            Sim2RealError: always.
        """
        raise Sim2RealError(
            "adapt=identify needs the logs of episodes and cannot be used in training: train with "
            "transforms=with_params adapt=none (the policy receives the truth), then evaluate or "
            "deploy it with adapt=identify"
        )


class IdentifySession(Session):
    """One robot's identification, an episode at a time; it may be saved between any two calls.

    Args:
        operator: the recipe, of an environment (`Identify.bind_environment`).
        theta: the policy's parameters, (P,).
        seed: of all that is random in it.

    Raises:
        Sim2RealError: an operator of no environment.
    """

    def __init__(self, operator: Identify, theta: np.ndarray, seed: int) -> None:
        if operator.context_spec is None:
            raise Sim2RealError("adapt=identify: call bind_environment(environment) before start")
        self._operator = self._recipe = operator
        self._spec = operator.context_spec
        self._theta, self._seed = np.array(theta, np.float32), seed
        self._values: list[float] = []
        self._logs: list[Log] = []
        self._found: list[np.ndarray] = []

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters' names, P of them."""
        return self._spec.names

    @property
    def history(self) -> np.ndarray:
        """The estimate after each episode so far, (n, P), each in its unit."""
        return np.array(self._found).reshape(-1, self._spec.size)

    @property
    def found(self) -> np.ndarray:
        """The robot's parameters as they are known now, (P,), each in its unit."""
        return self._found[-1].copy() if self._found else self._spec.center

    @property
    def result(self) -> np.ndarray:
        """The policy's parameters, followed by the assumed context, float32."""
        said = (self.found - self._spec.center) / self._spec.half_range
        return np.concatenate([self._theta, said]).astype(np.float32)

    def ask(self) -> np.ndarray | None:
        """Return the parameters to run for one episode, as `result`, or None when done."""
        return self.result if self.episodes_left else None

    def tell(
        self, value: float, steps: EpisodeTrajectory | None = None, log: Log | None = None
    ) -> None:
        """Report the return and the log of the episode that was asked for.

        Args:
            value: its undiscounted return.
            steps: not looked at.
            log: what was commanded and measured.

        Raises:
            Sim2RealError: when the adaptation is done, for a value that is not finite, for an
                episode without a log, or one that the identification refuses.
        """
        self._check(value)
        if log is None:
            raise Sim2RealError(
                f"adaptation: the return {value:.4g} came without a log, but adapt=identify needs "
                f"one; give tell(value, log=...) the episode's log"
            )
        logs = [*self._logs, log][-self._recipe.last :]
        self._found.append(np.asarray(self._recipe.find(logs, self._seed), np.float64))
        self._logs, self._values = logs, [*self._values, float(value)]

    def state_dict(self) -> dict[str, Any]:
        """Return the start, the returns, what was found and the logs that are still needed."""
        state = {
            "theta": torch.from_numpy(self._theta.copy()),
            "noise": torch.zeros(0, len(self._theta)),
            "seed": torch.tensor(self._seed),
            "values": torch.tensor(self._values, dtype=torch.float64),
            "found": torch.from_numpy(self.history),
        }
        for number, log in enumerate(self._logs):
            meta = json.dumps(log.meta).encode()
            state[f"log.{number}.{META}"] = torch.from_numpy(np.frombuffer(meta, np.uint8).copy())
            for name, column in log.columns.items():
                state[f"log.{number}.{name}"] = torch.from_numpy(np.array(column))
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to where `state_dict` was taken; nothing is identified again."""
        theta, values, found = (state[key].numpy() for key in ("theta", "values", "found"))
        self._theta, self._seed = np.array(theta, np.float32), int(state["seed"])
        self._values = [float(value) for value in values]
        self._found = [np.array(one) for one in found]
        packed: dict[int, dict[str, np.ndarray]] = {}
        for key, value in state.items():
            if key.startswith("log."):
                _, number, name = key.split(".", 2)
                packed.setdefault(int(number), {})[name] = value.numpy()
        self._logs = [_unpacked(packed[number]) for number in sorted(packed)]


def _unpacked(columns: dict[str, np.ndarray]) -> Log:
    meta = json.loads(columns.pop(META).tobytes())
    return Log(columns, meta)
