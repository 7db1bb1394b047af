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
    """A mistake that a log may have."""

    name: str  # see the table of `log_changes`
    columns: tuple[str, ...]  # kinds of columns that have it: `ctrl`, `qpos`, both, or `time`
    place: str | None  # the joint whose columns they are; None: those of all joints
    # returns the columns that would be others without it, from a log and values (P,)
    mend: Mend = field(compare=False)
    # what to do, with `{0}` for the first value and `{other}` for the second joint
    remedy: str = field(compare=False)
    # values to look at first, (K, P); (1, 0) where it has none
    probes: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)), compare=False)
    # values at which nothing is wrong, (P,), the smallest and the largest ones
    neutral: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)
    low: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)
    high: np.ndarray = field(default_factory=lambda: np.zeros(0), compare=False)
    value: float = 1.0  # what is reported as its value where it has none to fit
    other: str | None = None  # the second joint, if there is one
    unit: str = ""  # of the first value
    whole: bool = False  # whether values are whole numbers
    read: tuple[str, ...] = ()  # the joints whose readings it scales by its value
    # returns by how many rows all readings are late, from values (P,)
    late: Callable[[np.ndarray], float] = field(default=lambda values: 0.0, compare=False)
    seconds: Pair | None = None  # when it acts, of an episode; None: throughout
    variant: str | None = None  # what else tells it apart
    effect: Effect | None = None  # of the robot, which does this to its log; None: it is a mistake
    shown: bool = False  # whether the log's own columns contradict each other without it

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints whose columns they are; none where it is all of them."""
        return tuple(name for name in (self.place, self.other) if name)

    @property
    def parts(self) -> tuple[LogChange, ...]:
        """Itself: what its values are of."""
        return (self,)

    @property
    def label(self) -> str:
        """What tells it apart."""
        if self.effect is not None:
            return self.effect.label()
        places = filter(None, (*self.joints, self.variant))
        return ".".join(["log", self.name, *self.columns, *places])

    @property
    def law(self) -> str:
        """Its label: a log has each mistake once."""
        return self.label

    def mended(self, log: Log, values: np.ndarray) -> Log:
        """Return a log without the mistake."""
        return Log({**log.columns, **self.mend(log, values)}, log.meta, log.path)

    def mending(self, values: np.ndarray) -> str:
        """Return which columns to change, and how: `ctrl.elbow, qpos.elbow: multiply by -1`."""
        names = [kind if kind == TIME else f"{kind}.{self.place or '*'}" for kind in self.columns]
        return f"{', '.join(names)}: {self.remedy.format(*values, other=self.other)}"

    def first(self, values: np.ndarray) -> float:
        """Return the value that is reported."""
        return float(values[0]) if len(values) else self.value
