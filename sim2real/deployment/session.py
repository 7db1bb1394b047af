"""A policy's time on a robot, episode by episode: as trained, while it adapts, and afterwards.

    deployment = Deployment(theta, adapt, trials=3, seed=0)
    while (turn := deployment.next()) is not None:
        deployment.tell(run_one_episode(turn.theta, turn.seed))      # its return
        save(path, deployment)
    deployment.before, deployment.after                              # returns, a list each

The episodes before and after adaptation start alike, so that the starts' randomness cancels in
their difference. What is saved between two episodes is enough to go on in another process.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch

from hardware.files import atomic_write
from hardware.log import Log
from sim2real.learning.adapt import Adaptation, EpisodeTrajectory
from sim2real.learning.population.population import draw_seeds
from sim2real.runs.errors import Sim2RealError

DEPLOY_STREAM = 4  # which of the seed's streams starts and perturbations are drawn from
STATE = "state.npz"
Phase = Literal["before", "adapt", "after"]


class EpisodePlan(NamedTuple):
    """One episode to run: its phase, its number there, parameters (P,) and seed."""

    phase: Phase
    number: int
    theta: np.ndarray
    seed: int


@dataclass
class Deployment:
    """The plan of a deployment, and how far it is.

    Raises:
        Sim2RealError: fewer than one episode.
    """

    theta: np.ndarray  # the trained parameters, (P,)
    adapt: Adaptation  # how the policy adapts; an operator without episodes leaves it as it is
    trials: int  # episodes as trained, and as many after adaptation
    seed: int  # the seed of the starts and of the perturbations

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise Sim2RealError(f"trials={self.trials} must be at least 1")
        rng = np.random.default_rng([self.seed, DEPLOY_STREAM])
        self.session = self.adapt.start(self.theta, rng)
        self.fresh = draw_seeds(rng, self.trials)  # (trials,)
        self._luck = draw_seeds(rng, self.adapt.episodes)  # (E,)
        self.before: list[float] = []
        self.adapting: list[float] = []
        self.after: list[float] = []

    @property
    def adapts(self) -> bool:
        """Whether the policy changes at all."""
        return self.adapt.episodes > 0

    @property
    def total(self) -> int:
        """Episodes in all."""
        return self.trials * (1 + self.adapts) + self.adapt.episodes

    @property
    def done(self) -> int:
        """Number of reported episodes."""
        return len(self.before) + len(self.adapting) + len(self.after)

    def next(self) -> EpisodePlan | None:
        """Return the next episode to run, or None at the end."""
        if (number := len(self.before)) < self.trials:
            return EpisodePlan("before", number, self.theta, int(self.fresh[number]))
        candidate = self.session.ask()
        if candidate is not None:
            number = len(self.adapting)
            return EpisodePlan("adapt", number, candidate, int(self._luck[number]))
        if self.adapts and (number := len(self.after)) < self.trials:
            return EpisodePlan("after", number, self.session.result, int(self.fresh[number]))
        return None

    def explores(self, turn: EpisodePlan) -> bool:
        """Return whether an episode's actions are to be drawn, and its steps reported."""
        return turn.phase == "adapt" and self.adapt.explores

    def tell(
        self, value: float, steps: EpisodeTrajectory | None = None, log: Log | None = None
    ) -> None:
        """Report the return of the episode that `next` named.

        Args:
            value: the return.
            steps: what happened, of an episode that `explores`.
            log: what was commanded and measured, for an adaptation that `needs_log`.

        Raises:
            Sim2RealError: all have been reported, or a value that is not finite.
        """
        turn = self.next()
        if turn is None or not np.isfinite(value):
            raise Sim2RealError(
                f"deployment: a return of {value} after {self.done} of {self.total} episodes; "
                "returns are finite numbers, one for each episode"
            )
        if turn.phase == "adapt":
            self.session.tell(value, steps, log)
        {"before": self.before, "adapt": self.adapting, "after": self.after}[turn.phase].append(
            float(value)
        )

    def state_dict(self) -> dict[str, np.ndarray]:
        """Return all that the rest of the deployment depends on, as arrays."""
        session = {f"session.{k}": v.numpy() for k, v in self.session.state_dict().items()}
        returns = {name: np.array(getattr(self, name)) for name in ("before", "adapting", "after")}
        return {**session, **returns, "fresh": self.fresh, "luck": self._luck}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from where `state_dict` was taken.

        Raises:
            Sim2RealError: the state is of another policy, adaptation or number of trials.
        """
        theta, noise = state["session.theta"], state["session.noise"]
        if not np.array_equal(theta, np.asarray(self.theta, np.float32)):
            raise Sim2RealError("resume: the deployment used another policy; give its checkpoint")
        same = noise.shape[0] == self.adapt.queries and len(state["luck"]) == self.adapt.episodes
        if not same or len(state["fresh"]) != self.trials:
            raise Sim2RealError(
                f"resume: the deployment had {len(state['fresh'])} trials and "
                f"{len(state['luck'])} episodes of adaptation, this one has {self.trials} and "
                f"{self.adapt.episodes}; give the same trials= and adapt="
            )
        parts = {
            k.removeprefix("session."): torch.from_numpy(np.array(v))
            for k, v in state.items()
            if k.startswith("session.")
        }
        self.session.load_state_dict(parts)
        self.fresh, self._luck = np.array(state["fresh"]), np.array(state["luck"])
        for name in ("before", "adapting", "after"):
            setattr(self, name, [float(value) for value in state[name]])


def save(path: Path, deployment: Deployment) -> None:
    """Write the progress of a deployment atomically."""
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **deployment.state_dict())


def load(path: str | Path, deployment: Deployment) -> None:
    """Put a deployment where another was when it was saved.

    Args:
        path: its run's folder, or the state.npz in it.
        deployment: a deployment of the same policy, adaptation and number of trials.

    Raises:
        Sim2RealError: there is no such file, it is damaged, or it does not fit.
    """
    path = Path(path).expanduser()
    path = path / STATE if path.is_dir() else path
    try:
        with np.load(path, allow_pickle=False) as file:
            state = {name: file[name] for name in file.files}
        deployment.load_state_dict(state)
    except (OSError, KeyError, EOFError, ValueError) as error:
        if isinstance(error, Sim2RealError):
            raise
        raise Sim2RealError(
            f"resume={path}: the deployment is incomplete or damaged ({error}); give the folder "
            "of an interrupted one"
        ) from error
