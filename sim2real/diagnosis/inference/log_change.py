"""One thing that may be wrong with a log: its values, and the log without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from envs.effects import Effect
from hardware.log import Log
from sim2real.diagnosis.evidence import Pair
from sim2real.diagnosis.inference.columns import TIME, Columns

Mend = Callable[[Log, np.ndarray], Columns]


@dataclass(frozen=True)
class LogChange:
    """A mistake that a log may have.

    Args:
        effect: its name; see the table.
        columns: the kinds of columns that have it: `ctrl`, `qpos`, both, or `time`.
        where: the joint whose columns they are; None: those of all joints.
        mend: returns the columns that would be others without it, from a log and values (P,).
        remedy: what to do, with `{0}` for the first value.
        probes: values to look at first, (K, P); (1, 0) where it has none.
        neutral: values at which nothing is wrong, (P,).
        low: smallest values, (P,).
        high: largest values, (P,).
        value: what is reported as its value where it has none to fit.
        other: the second joint, if there is one.
        unit: of the first value.
        whole: whether values are whole numbers.
        read: the joints whose readings it scales by its value.
        late: returns by how many rows all readings are late, from values (P,).
        seconds: when it acts, of an episode; None: throughout.
        variant: what else tells it apart.
        robot: the effect of the robot that does this to its log; None: it is a mistake.
        shown: whether the log's own columns contradict each other without it.
    """

    effect: str
    columns: tuple[str, ...]
    where: str | None
    mend: Mend = field(compare=False)
    remedy: str = field(compare=False)
    probes: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)), compare=False)
    neutral: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)
    low: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)
    high: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)
    value: float = 1.0
    other: str | None = None
    unit: str = ""
    whole: bool = False
    read: tuple[str, ...] = ()
    late: Callable[[np.ndarray], float] = field(default=lambda values: 0.0, compare=False)
    seconds: Pair | None = None
    variant: str | None = None
    robot: Effect | None = None
    shown: bool = False

    @property
    def parts(self) -> tuple[LogChange, ...]:
        """Itself: what its values are of."""
        return (self,)

    @property
    def label(self) -> str:
        """What tells it apart."""
        if self.robot is not None:
            return self.robot.label()
        places = (self.where, self.other, self.variant)
        return ".".join(["log", self.effect, *self.columns, *filter(None, places)])

    def mended(self, log: Log, values: np.ndarray) -> Log:
        """Return a log without the mistake."""
        return Log({**log.columns, **self.mend(log, values)}, log.meta, log.path)

    def mending(self, values: np.ndarray) -> str:
        """Return which columns to change, and how: `ctrl.elbow, qpos.elbow: multiply by -1`."""
        names = [kind if kind == TIME else f"{kind}.{self.where or '*'}" for kind in self.columns]
        return f"{', '.join(names)}: {self.remedy.format(*values)}"

    def first(self, values: np.ndarray) -> float:
        """Return the value that is reported."""
        return float(values[0]) if len(values) else self.value
