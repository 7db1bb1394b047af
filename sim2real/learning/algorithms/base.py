"""The components and the interface of training algorithms.

class Mine(Algorithm):
    uses = frozenset({"optimizer"})             # the optional parts that it takes
    def __init__(self, parts: Parts, *, num_rows: int) -> None: ...

algorithm = build(partial(Mine, num_rows=8), Components(environment, policy, seed=0))
while algorithm.frames < 500_000:
    metrics = algorithm.iterate()
algorithm.trained()                             # the policy, to evaluate, export or deploy
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from envs.randomization import Tasks
from sim2real.learning.adapt import Adaptation, NoAdaptation
from sim2real.learning.algorithms.checks import check_part
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.population import AdaptationScores, Population
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True)
class Components:
    """The components of an algorithm.

    Raises:
        Sim2RealError: a number of an optional part that is out of range.
    """

    environment: EnvironmentFactory  # makes the worlds of training and evaluation
    policy: Callable[..., Any]  # makes the policy; of what, the algorithm says
    seed: int = 0  # all randomness of a run follows from it
    adapt: Adaptation = field(default_factory=NoAdaptation)  # how the policy adapts
    # makes what gathers experience, as `torchrl.collectors.Collector` is made
    collector: Callable[..., Any] | None = None
    # makes the estimator of advantages, as `torchrl.objectives.value.GAE` is made
    advantage: Callable[..., Any] | None = None
    loss: Callable[..., Any] | None = None  # makes the loss from the policy's networks
    buffer: Callable[..., Any] | None = None  # makes the buffer that minibatches are drawn from
    optimizer: Callable[..., Any] | None = None  # makes the optimizer from parameters
    device: str = "cpu"  # where networks are

    def __post_init__(self) -> None:
        for name, part in self.optional.items():
            check_part(name, part)

    @property
    def tasks(self) -> Tasks:
        """The distribution of robots in episodes."""
        return self.environment.tasks

    @property
    def optional(self) -> dict[str, Callable[..., Any] | None]:
        """The parts that not every algorithm takes, by name."""
        return {
            "collector": self.collector,
            "advantage": self.advantage,
            "loss": self.loss,
            "buffer": self.buffer,
            "optimizer": self.optimizer,
        }

    def with_effects(self, effects: str | Path | None) -> Components:
        """Return these with the effects of a file in every robot; see `EnvironmentFactory`."""
        return replace(self, environment=self.environment.with_effects(effects))

    def part(self, name: str) -> Callable[..., Any]:
        """Return an optional part; raises Sim2RealError where there is none."""
        made = self.optional[name]
        if made is None:
            raise Sim2RealError(f"{name}=null, but the algorithm needs one; choose {name}=NAME")
        return made


class Algorithm(ABC):
    """Something that improves a policy, one iteration at a time.

    Attributes:
        uses: the optional parts that it takes, of adapt, collector, advantage, loss, buffer and
            optimizer; one that is set and not taken is refused.
        parts: what it was made of.
        frames: environment steps taken so far, all episodes of training counted.
        iteration: iterations done.
        population: where its candidates' episodes run, which a cluster may take over; None for an
            algorithm without candidates.
        collecting: what gathers its experience; None for an algorithm without a collector.
        adapts_by: the kind of adaptation that it trains for.
    """

    adapts_by: ClassVar[type[Adaptation]] = Adaptation
    uses: ClassVar[frozenset[str]] = frozenset()
    parts: Components
    frames: int
    iteration: int
    population: Population | None = None
    collecting: Any = None

    def close(self) -> None:
        """End the processes that the algorithm started, such as those of a collector."""
        if self.collecting is not None:
            self.collecting.close()

    @abstractmethod
    def iterate(self) -> dict[str, float]:
        """Do one iteration and return its metrics, named `train/...`."""

    @abstractmethod
    def trained(self) -> TrainedPolicy:
        """Return the present policy; training on does not change it."""

    @property
    @abstractmethod
    def shape(self) -> dict[str, Any]:
        """The shape that a checkpoint's parameters must have, as JSON holds it."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on: tensors, numbers and names."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to a state: iterations then equal those of the run that it is from."""

    def load_policy(self, state: dict[str, Any]) -> None:
        """Take over of a state what `trained` needs, to act and not to go on training."""
        self.load_state_dict(state)

    def scores(
        self, values: np.ndarray, seeds: np.ndarray, episodes: int
    ) -> AdaptationScores | None:
        """Return the returns before and after adaptation; None where the policy does not adapt."""
        return None

    def adapted(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """Return the parameters that the policy adapts to on a robot; None if it does not adapt."""
        return None

    @property
    def identity(self) -> dict[str, Any]:
        """The settings that a checkpoint must share with a run that continues it."""
        name = self.parts.environment.name
        return {"task": name, "algorithm": type(self).__name__, "policy": self.shape}


def build(algorithm: Callable[..., Algorithm], parts: Components, adapts: bool = True) -> Algorithm:
    """Make an algorithm of its parts.

    Args:
        algorithm: makes it.
        parts: what it is given.
        adapts: whether the policy is to adapt in training; afterwards any policy can.

    Raises:
        Sim2RealError: a part that was chosen and that it does not use.
    """
    made = algorithm(parts)
    name = type(made).__name__
    if adapts and "adapt" not in made.uses and not isinstance(parts.adapt, NoAdaptation):
        raise Sim2RealError(f"{name} cannot train a policy that adapts; use adapt=none")
    if adapts and parts.adapt.needs_log:
        raise Sim2RealError(
            f"{name} cannot train with {parts.adapt}; train with transforms=with_params and "
            "adapt=none, which gives it the true parameters, and evaluate or deploy it with "
            f"adapt=identify"
        )
    if adapts and not isinstance(parts.adapt, made.adapts_by):
        raise Sim2RealError(
            f"{name} trains for adaptation by {made.adapts_by.__name__}, but the run has "
            f"{type(parts.adapt).__name__}; leave adapt out, or choose adapt=policy_gradient"
        )
    parts.adapt.check(getattr(made, "policy", None))
    for one, part in parts.optional.items():
        if part is not None and one not in made.uses:
            raise Sim2RealError(f"{name} does not use {one}; remove it, or set {one}=none")
    return made
