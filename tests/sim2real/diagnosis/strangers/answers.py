"""What a report is expected to say, and whether it does.

    wanted = Expected("log", {"turn"}, {"elbow"}, near=(1.0, 0.05))
    wanted.miss(report)                             # None, or what is wrong in a sentence

Causes are those of `report.json` schema 3: each has a `kind`, which is `robot` (an effect), `log`
(a mistake of the log) or `world`. In a report of schema 2 every cause is of kind `robot`.
"""

import math
from collections.abc import Set
from dataclasses import dataclass

from sim2real.diagnosis.schema import Cause, Report

BETTER = frozenset({"explained", "partly_explained"})


@dataclass(frozen=True)
class Expected:
    """The answer to a situation.

    Args:
        kind: of the first cause: robot, log or world.
        effects: names of which the first cause or an equivalent of it has to have one.
        where: places of which it has to have one; None is the robot.
        near: a value and by how much the first cause's may differ from it.
        columns: whose rows are late; a late command is an early reading, of the other sign.
        factor: a value and by which factor the first cause's may differ from it.
        at: when, as a time and a tolerance [s].
        verdicts: that are right.
    """

    kind: str
    effects: Set[str]
    where: Set[str | None]
    near: tuple[float, float] | None = None
    columns: tuple[str, ...] = ()
    factor: tuple[float, float] | None = None
    at: tuple[float, float] | None = None
    verdicts: Set[str] = BETTER

    def miss(self, report: Report) -> str | None:
        """Return what a report says otherwise; None where it is right."""
        said = ", ".join(f"{kind_of(c)} {c.effect} at {c.where} {c.value:g}" for c in report.causes)
        if report.verdict not in self.verdicts:
            return f"called {report.verdict} ({said})"
        if not report.causes:
            return f"{report.verdict}, but no cause is named"
        first = report.causes[0]
        every = [(first.effect, first.where), *((e.effect, e.where) for e in first.equivalent)]
        named = any(effect in self.effects and where in self.where for effect, where in every)
        if kind_of(first) != self.kind or not named:
            return f"named {said}"
        if not self._is_right(first):
            return f"the value is {first.value:g}, at {getattr(first, 'seconds', None)} s"
        others = [cause for cause in report.causes if kind_of(cause) != self.kind]
        return f"superfluous: {said}" if others else None

    def _is_right(self, cause: Cause) -> bool:
        seconds = getattr(cause, "seconds", None)
        if self.at and (seconds is None or abs(first_of(seconds) - self.at[0]) > self.at[1]):
            return False
        if cause.effect not in self.effects:  # an equivalent was meant, whose value is not told
            return True
        other = self.columns and tuple(cause.extra["columns"]) != self.columns
        value = -cause.value if other else cause.value
        if self.near and abs(value - self.near[0]) > self.near[1]:
            return False
        if self.factor is None:
            return True
        value, by = self.factor
        return cause.value * value > 0 and abs(math.log(cause.value / value)) <= math.log(by)


def kind_of(cause: Cause) -> str:
    """Return what a cause is a cause of: the robot, the log or the world."""
    return getattr(cause, "kind", "robot")


def first_of(seconds: float | tuple[float, ...]) -> float:
    """Return when something begins [s], of a time or a span."""
    return float(seconds[0]) if isinstance(seconds, tuple | list) else float(seconds)
