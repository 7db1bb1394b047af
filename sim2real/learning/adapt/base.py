"""The interface of adaptation operators: stages of episodes, batched and single sessions.

The episodes of an operator are numbered 0 … E - 1 and fall into **stages**: the candidates of a
stage depend only on the values of earlier stages. So the episodes of one stage may run at the same
time and report in any order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch

from hardware.log import Log
from sim2real.learning.modules.value import Critic
from sim2real.runs.errors import Sim2RealError


class EpisodeTrajectory(NamedTuple):
    """An episode of T steps whose actions were drawn."""

    observation: np.ndarray  # (T, O) float32, as the policy saw it
    action: np.ndarray  # (T, A) float32, as drawn, before anything cuts it
    reward: np.ndarray  # (T,)
    end: np.ndarray | None = None  # (O,) float32, what it saw last; None where the task ended it


class Adaptation(ABC):
    """A recipe that changes a parameter vector by a fixed number of episodes.

    Attributes:
        explores: whether it needs episodes whose actions are drawn, and their steps as well as
            their returns.
        needs_log: whether it needs the logs of its episodes, and their returns decide nothing.
        needs_critic: whether it needs the policy's critic and changes that, too.
    """

    explores: ClassVar[bool] = False
    needs_log: ClassVar[bool] = False
    needs_critic: ClassVar[bool] = False

    @property
    @abstractmethod
    def stages(self) -> tuple[int, ...]:
        """Episodes of each stage, in order."""

    @property
    @abstractmethod
    def queries(self) -> int:
        """Perturbations drawn per member."""

    @abstractmethod
    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> BatchedSession:
        """Start members with given perturbations.

        Args:
            thetas: parameters before adaptation, (n, P).
            noise: standard normal perturbations, (n, queries, P) float32.
        """

    @property
    def episodes(self) -> int:
        """Episodes that an adaptation spends, those of the unchanged policy included."""
        return sum(self.stages)

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return f"{type(self).__name__}, {self.episodes} episodes"

    def check(self, policy: Any) -> None:  # noqa: B027 - most adapt any policy
        """Raise Sim2RealError for a policy that cannot adapt so; None is one that is not known."""

    def bind_policy(self, actor: Any, critic: Critic | None = None) -> Adaptation:
        """Return this recipe for a policy's actor, a tensordict module, and its critic, if any.

        Most serve any policy.
        """
        return self

    def bind_environment(self, environment: Any) -> Adaptation:
        """Return this recipe for policies of an environment; most serve any."""
        return self

    def start(self, theta: np.ndarray, rng: np.random.Generator) -> Session:
        """Start one adaptation that asks for one episode at a time.

        Args:
            theta: parameters before adaptation, (P,).
            rng: source of the perturbations, which are all drawn now.
        """
        return Session(self, theta, self.draw(rng, len(theta)))

    def start_many(self, thetas: np.ndarray, rngs: Sequence[np.random.Generator]) -> BatchedSession:
        """Start n adaptations side by side; member i equals `start(thetas[i], rngs[i])`."""
        noise = np.empty((len(thetas), self.queries, thetas.shape[1]), np.float32)
        for member, rng in enumerate(rngs):
            noise[member] = self.draw(rng, thetas.shape[1])
        return self.start_batch(thetas, noise)

    def draw(self, rng: np.random.Generator, size: int) -> np.ndarray:
        """Draw one member's perturbations, (queries, size) float32."""
        return rng.standard_normal((self.queries, size), dtype=np.float32)


def check_budget(operator: Adaptation, budget: int | None, fits: str) -> None:
    """Refuse an operator that does not spend the episodes that it is allowed.

    Args:
        operator: as made of its other arguments.
        budget: required number of episodes; None: not checked.
        fits: what to set instead.

    Raises:
        Sim2RealError: it spends more or fewer.
    """
    if budget is not None and operator.episodes != budget:
        raise Sim2RealError(
            f"adapt.budget={budget} does not fit {operator}; {fits}, or leave the budget out"
        )


class BatchedSession(ABC):
    """Many members that go through one operator side by side, each at its own pace.

    A member's numbers do not depend on the other members or on the order of calls.

    Args:
        stages: episodes of each stage.
        thetas: parameters before adaptation, (n, P).
        noise: perturbations, (n, queries, P) float32.
    """

    def __init__(self, stages: tuple[int, ...], thetas: np.ndarray, noise: np.ndarray) -> None:
        self.stages = stages
        self.results = np.array(thetas, np.float32)  # (n, P): the incumbent, at the end the result
        self.noise = noise
        self.values = np.full((len(thetas), sum(stages)), np.nan)  # (n, E) returns reported so far
        self._ends = np.cumsum((0, *stages))  # first episode of each stage, then E
        self._stage = np.zeros(len(thetas), np.int64)
        self._reported = np.zeros(len(thetas), np.int64)

    def available(self, member: int) -> range:
        """Return the episodes of the member's present stage; empty when it is done."""
        stage = self._stage[member]
        return range(0) if stage == len(self.stages) else range(*self._ends[stage : stage + 2])

    @abstractmethod
    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Return the parameters to try in these episodes.

        Args:
            members: (k,).
            episodes: an episode of each member's present stage, (k,).

        Returns:
            (k, P) float32.
        """

    def tell(self, members: np.ndarray, episodes: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Report returns.

        Args:
            members: (k,); a member may occur more than once.
            episodes: which of its present stage's episodes, (k,).
            values: their undiscounted returns, (k,).

        Returns:
            The members whose stage is now complete, sorted; they are in their next stage.

        Raises:
            Sim2RealError: for a value that is not finite.
        """
        if not np.isfinite(values).all():
            raise Sim2RealError(f"adaptation: returns must be finite numbers, got {values}")
        self.values[members, episodes] = values
        np.add.at(self._reported, members, 1)
        touched = np.unique(members)
        complete = touched[self._reported[touched] == self._ends[self._stage[touched] + 1]]
        stages = self._stage[complete]
        for stage in np.unique(stages):
            self._advance(complete[stages == stage], int(stage))
        self._stage[complete] += 1
        return complete

    @abstractmethod
    def _advance(self, members: np.ndarray, stage: int) -> None:
        """Digest a complete stage of some members."""

    def _stage_values(self, members: np.ndarray, stage: int) -> np.ndarray:
        """Return the values of a stage, (k, episodes of the stage)."""
        return self.values[members, self._ends[stage] : self._ends[stage + 1]]


class Session:
    """The adaptation of one robot, one episode at a time; can be saved between calls.

    Args:
        operator: the adaptation operator.
        theta: parameters before adaptation, (P,).
        noise: its perturbations, (queries, P).
    """

    def __init__(self, operator: Adaptation, theta: np.ndarray, noise: np.ndarray) -> None:
        self._operator = operator
        self._begin(theta, noise, np.empty(0))

    def _begin(self, theta: np.ndarray, noise: np.ndarray, values: np.ndarray) -> None:
        self._theta = np.array(theta, np.float32)
        self._cohort = self._operator.start_batch(
            self._theta[None], np.asarray(noise, np.float32)[None]
        )
        self._values: list[float] = []
        for value in values:
            self.tell(float(value))

    @property
    def episodes_left(self) -> int:
        """Number of remaining episodes."""
        return self._operator.episodes - len(self._values)

    @property
    def result(self) -> np.ndarray:
        """Current parameters, (P,) float32; final after `ask` returned None."""
        return self._cohort.results[0].copy()

    def ask(self) -> np.ndarray | None:
        """Return parameters for the next episode, (P,) float32, or None at the end."""
        if self.episodes_left == 0:
            return None
        return self._cohort.candidates(np.array([0]), np.array([len(self._values)]))[0]

    def tell(
        self, value: float, steps: EpisodeTrajectory | None = None, log: Log | None = None
    ) -> None:
        """Report the return of the last requested episode.

        Args:
            value: its undiscounted return.
            steps: its transitions, for an operator that `explores`.
            log: its log, for an operator that `needs_log`.

        Raises:
            Sim2RealError: the adaptation is complete, or the value is not finite.
        """
        self._check(value)
        self._cohort.tell(np.array([0]), np.array([len(self._values)]), np.array([value]))
        self._values.append(float(value))

    def _check(self, *told: Any) -> None:
        """Raise Sim2RealError where no more is asked, or for numbers that are not finite."""
        if self.episodes_left == 0:
            raise Sim2RealError(
                f"adaptation: all {self._operator.episodes} episodes have been reported"
            )
        if not all(np.isfinite(numbers).all() for numbers in told):
            raise Sim2RealError("adaptation: returns and steps must be finite numbers")

    def state_dict(self) -> dict[str, Any]:
        """Return the start, the perturbations and the returns so far, as tensors."""
        return {
            "theta": torch.from_numpy(self._theta.copy()),
            "noise": torch.from_numpy(self._cohort.noise[0].copy()),
            "values": torch.tensor(self._values, dtype=torch.float64),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state by reporting its returns again."""
        self._begin(*(state[key].numpy() for key in ("theta", "noise", "values")))


class NoAdaptation(Adaptation):
    """Leaves the policy as it is: domain randomization, the baseline of every adaptation."""

    def __str__(self) -> str:
        """Say that there is none."""
        return "no adaptation"

    @property
    def stages(self) -> tuple[int, ...]:
        """None."""
        return ()

    @property
    def queries(self) -> int:
        """None."""
        return 0

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> BatchedSession:
        """Start members that are done at once."""
        return _Unchanged((), thetas, noise)


class _Unchanged(BatchedSession):
    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        return self.results[members]

    def _advance(self, members: np.ndarray, stage: int) -> None:
        pass
