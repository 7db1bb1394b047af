"""BayRn: which distribution of simulators trains the policy that earns most on the robot?

    session = BayRn(first=8, rounds=20).start(prior, seed=0)
    while (distribution := session.ask()) is not None:
        policy = train_under(distribution)
        session.tell(mean_return_on_the_robot(policy))
    session.result                                  # the distribution that is best

Muratore, Eilers, Gienger and Peters, "Data-efficient domain randomization with Bayesian
optimization" (RA-L 2021). Means and standard deviations of the simulator's parameters are points; a
point's value is what the policy that was trained there earns on the robot, so nothing has to be
measured but returns. A Gaussian process says where to train next (`identification.bayesian`).

It has no `Method.fit`: nothing is fitted to logs, and each value costs a training, of which
`identification` knows nothing. So it is a loop. As in the paper, the answer is where the process
expects most, here among the points that were tried: their policies are there already.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from envs.distribution import Distribution
from envs.distribution_file import write
from sim2real.identification.bayesian import expected, promising, require, spread
from sim2real.identification.methods.base import gaussian
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

STATE, FILE = "bayrn.json", "distribution.yaml"
Try = Callable[[Distribution, str], float]  # a distribution, the name of its folder -> a return


class BayRn:
    """Bayesian optimization over distributions, scored on the robot.

    Args:
        first: distributions that are spread evenly, before the process says anything.
        rounds: total number of distributions, each with a training and robot time.
        narrowest: least standard deviation of a parameter, in widths of the prior.
        widest: largest.

    Raises:
        Sim2RealError: a number out of its range.
    """

    def __init__(
        self, first: int = 8, rounds: int = 20, narrowest: float = 0.02, widest: float = 0.3
    ) -> None:
        if not 2 <= first <= rounds:
            raise Sim2RealError(
                f"bayrn: first={first} must be at least 2 and at most rounds={rounds}"
            )
        if not 0 < narrowest < widest:
            raise Sim2RealError(
                f"bayrn: narrowest={narrowest:g} must be above 0 and below widest={widest:g}"
            )
        self.first, self.rounds = first, rounds
        self.narrowest, self.widest = narrowest, widest

    def start(self, prior: Distribution, seed: int) -> Session:
        """Start one search.

        Args:
            prior: the ends between which distributions lie, P parameters.
            seed: of all that is random.

        Raises:
            Sim2RealError: the library is not installed.
        """
        require("improve by=returns")
        return Session(self, prior, seed)


class Session:
    """One search, a distribution at a time, as `BayRn.start` starts it.

    It is deterministic given its seed and the reported values.
    """

    def __init__(self, recipe: BayRn, prior: Distribution, seed: int) -> None:
        self._recipe, self.prior, self._seed = recipe, prior, seed
        self._points = spread(2 * len(prior.names), recipe.first, seed)  # (n, 2 P), shares
        self.values: list[float] = []

    @property
    def tried(self) -> list[Distribution]:
        """The distributions whose values were reported, in their order."""
        return [self._meant(point) for point in self._points[: len(self.values)]]

    @property
    def expected(self) -> np.ndarray:
        """The process's prediction for each distribution that was tried, (n,)."""
        return expected(self._points[: len(self.values)], np.array(self.values))

    @property
    def best(self) -> int:
        """The place of the best among those that were tried.

        Raises:
            Sim2RealError: fewer than two were.
        """
        if len(self.values) < 2:
            raise Sim2RealError(f"bayrn: {len(self.values)} values are too few; report at least 2")
        return int(self.expected.argmax())

    @property
    def result(self) -> Distribution:
        """The best of the distributions that were tried; see `best`."""
        return self.tried[self.best]

    def ask(self) -> Distribution | None:
        """Return the distribution to train under next; None when all are tried."""
        done = len(self.values)
        if done == self._recipe.rounds:
            return None
        if done == len(self._points):
            more = promising(self._points, np.array(self.values), 1, self._seed + done)
            self._points = np.concatenate([self._points, more])
        return self._meant(self._points[done])

    def tell(self, value: float) -> None:
        """Report what the policy earned on the robot, the mean of its episodes.

        Raises:
            Sim2RealError: a value that is not finite, or one that was not asked for.
        """
        if len(self.values) >= len(self._points):
            raise Sim2RealError(
                "bayrn: a value was reported before it was asked for; call ask() first"
            )
        if not math.isfinite(value):
            raise Sim2RealError(f"bayrn: a return must be a finite number, got {value}")
        self.values.append(float(value))

    def state_dict(self) -> dict[str, Any]:
        """Return the points asked and the values reported, as JSON holds them."""
        return {"seed": self._seed, "points": self._points.tolist(), "values": self.values}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a state.

        Raises:
            Sim2RealError: that of another search.
        """
        points, values = np.array(state["points"], np.float64), list(state["values"])
        begin = min(len(points), self._recipe.first)
        if state["seed"] != self._seed or not np.array_equal(points[:begin], self._points[:begin]):
            raise Sim2RealError(
                "bayrn: the resumed search had other settings; give the same seed, params "
                "and bayrn.first, or start again without resume"
            )
        self._points, self.values = points, values

    def _meant(self, point: np.ndarray) -> Distribution:
        """Return the normal laws that a point (2 P,) in the unit cube stands for."""
        prior, width = self.prior, self.prior.high - self.prior.low
        mean, size = np.split(point, 2)
        low, high = math.log(self._recipe.narrowest), math.log(self._recipe.widest)
        std = width * np.exp(low + size * (high - low))
        return gaussian(prior, prior.low + mean * width, np.diag(std**2))


def search(session: Session, attempt: Try, folder: Path) -> Session:
    """Try distributions until all rounds are done, from where a search in this folder stopped.

    Args:
        session: asks for distributions and receives their values.
        attempt: trains under a distribution, in a folder of that name, and returns what the policy
            earned on the robot.
        folder: gets NN/distribution.yaml of each round, bayrn.json after each, and in the end
            table.md, table.csv and distribution.yaml, the best.
    """
    if (folder / STATE).is_file():
        session.load_state_dict(json.loads((folder / STATE).read_text(encoding="utf-8")))
    while (distribution := session.ask()) is not None:
        name = f"{len(session.values) + 1:02d}"
        (folder / name).mkdir(parents=True, exist_ok=True)
        write(folder / name / FILE, distribution)
        session.tell(attempt(distribution, name))
        write_text(folder / STATE, json.dumps(session.state_dict()) + "\n")
    write(folder / FILE, session.result)
    table(session).write(folder / "table", "Distributions, and what policies trained there earned")
    return session


def table(session: Session) -> Table:
    """Return a line for each distribution that was tried."""
    names = session.prior.names
    made = Table(("round", "return on the robot", "expected", *names))
    for number, (value, predicted, one) in enumerate(
        zip(session.values, session.expected, session.tried, strict=True), start=1
    ):
        laws = [f"{law.mean:.3g} ± {law.std:.2g}" for law in one.laws]
        made.add(f"{number:02d}", value, float(predicted), *laws)
    made.notes.append(
        f"Round {session.best + 1:02d} is best: there the Gaussian process of the returns expects "
        "most. Parameters: mean ± standard deviation of the normal law, cut at the prior's ends."
    )
    return made
