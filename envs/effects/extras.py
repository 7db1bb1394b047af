"""Descriptions of an effect's further scalars, and of the sizes in which an exam hides it."""

import math
from typing import Literal, NamedTuple

PHASE = "phase"  # the name of a phase that may be fitted
Form = Literal["add", "signed", "factor", "limit", "mass", "tilt"]


class Extra(NamedTuple):
    """A further scalar of an effect: a constant, or a parameter where it is in `free`."""

    name: str  # the name of the argument
    unit: str  # SI unit, "" for a pure number
    default: float | None  # its value where none is given; None: one must be given
    low: float  # smallest value
    high: float  # largest value
    about: str  # what it is
    # range within which a diagnosis fits it together with the value; None: it stays constant
    fit: tuple[float, float] | None = None
    # what real robots show; the exam's search for rivals goes through all of it. None: it stays
    # constant there.
    typical: tuple[float, float] | None = None
    # whether it is fitted only once the effect is part of an answer; such extras come last
    later: bool = False


def phase(about: str) -> Extra:
    """Return an extra, described by `about`: the phase [rad] of a wave of the value's amplitude."""
    turn = 2 * math.pi
    return Extra(PHASE, "rad", 0.0, -turn, turn, about, fit=(-turn, turn), typical=(-3.2, 3.2))


class Sizes(NamedTuple):
    """The sizes in which an exam hides an effect: multiples of one of the robot's own values.

    Args:
        form: how a size becomes a value: `add` size * unit, `signed` the same with a drawn sign,
            `factor` exp(± size), `limit` unit / size, `mass` unit * (exp(± size) - 1), `tilt` a
            rotation by size about a drawn horizontal axis.
        unit: the number, such as `stall` for the stall torque (`sim2real.exam.hiding.scales`).
        low: the least size that is tried.
        high: the largest.
    """

    form: Form
    unit: str
    low: float
    high: float
