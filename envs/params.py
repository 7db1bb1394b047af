"""The parameter space: named scalars of a simulated robot, and where they mean something.

    torso = Parameter("link_mass.torso", "link_mass", "torso", unit="kg", neutral=0.0, low=-3.6)
    space = ParamSpace([torso])
    space.validate(np.array([[0.5], [-4.0]]))      # ParameterError: a mass below zero

Randomization draws parameters, a meta-learning task is a draw, identification fits them, an
evaluation grid sweeps them, diagnosis asks which one is not neutral. Every one of them speaks in
these names.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from envs.errors import ParameterError, did_you_mean

How = Literal["set", "add", "scale"]
Side = Literal["motor", "link"]


@dataclass(frozen=True)
class Parameter:
    """One named scalar of a simulated robot.

    Args:
        name: `effect.where`, or `effect` alone for the whole robot; further scalars of one effect
            append `.scalar`.
        effect: standard name of the effect that it belongs to.
        where: joint, actuator, body or geom that it acts on; None for the robot.
        side: for backlash and compliance, the side of them on which the encoder sits.
        unit: SI unit of the value, "" for a pure number.
        neutral: the value at which the effect is absent.
        low: smallest value that means something (physics, not a randomization range).
        high: largest such value.
        how: whether the value replaces, is added to or multiplies what the model says.
    """

    name: str
    effect: str
    where: str | None = None
    side: Side | None = None
    unit: str = ""
    neutral: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    how: How = "add"


class ParamSpace:
    """An ordered set of P parameters; a point of it is a row of P values."""

    def __init__(self, parameters: Sequence[Parameter] = ()) -> None:
        """Raises ParameterError if two parameters have one name."""
        self.parameters = tuple(parameters)
        self.names = tuple(p.name for p in self.parameters)
        for name in self.names:
            if self.names.count(name) > 1:
                raise ParameterError(f"parameter {name!r} is given twice; keep one of them")
        self.neutral = np.array([p.neutral for p in self.parameters], dtype=np.float64)  # (P,)
        self.low = np.array([p.low for p in self.parameters], dtype=np.float64)  # (P,)
        self.high = np.array([p.high for p in self.parameters], dtype=np.float64)  # (P,)

    @property
    def size(self) -> int:
        """P, the number of parameters."""
        return len(self.parameters)

    def index(self, name: str) -> int:
        """Return a parameter's column; raises ParameterError for a name that the space lacks."""
        if name not in self.names:
            known = f"one of: {', '.join(self.names)}, or " if self.names else ""
            raise ParameterError(
                f"no parameter {name!r}{did_you_mean(name, self.names)}; choose {known}params=NAME "
                "that draws it"
            )
        return self.names.index(name)

    def points(self, n: int) -> np.ndarray:
        """Return n neutral points, (n, P)."""
        return np.tile(self.neutral, (n, 1))

    def validate(self, values: np.ndarray) -> np.ndarray:
        """Return values as (n, P) float64 after checking them.

        Raises:
            ParameterError: wrong shape, or a value that is not finite or outside its parameter's
                range; names the first such value.
        """
        values = np.asarray(values, dtype=np.float64)
        if values.ndim != 2 or values.shape[1] != self.size:
            raise ParameterError(
                f"parameter values must have shape (n, {self.size}), got {values.shape}"
            )
        wrong = ~((values >= self.low) & (values <= self.high) & np.isfinite(values))
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            p = self.parameters[column]
            raise ParameterError(
                f"{p.name} = {values[row, column]:g} {p.unit} (row {row}) is outside"
                f" [{p.low:g}, {p.high:g}] ({p.how})"
            )
        return values
