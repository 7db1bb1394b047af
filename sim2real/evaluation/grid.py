"""A grid over the parameter space: the robots that a policy is tried on.

grid = Grid([{"parameter": "link_mass.torso", "low": 0.5, "high": 11.5, "count": 12},
             {"parameter": "ground_friction", "low": 0.1, "high": 2.9, "count": 15}])
grid.values(space)                      # (180, P): the last axis varies fastest
grid.inside(training_range(tasks, space))    # (180,) bool, see `learning.context`

Parameters without an axis are neutral.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from envs.params import Parameter, ParamSpace
from sim2real.runs.errors import Sim2RealError

Box = dict[str, tuple[float, float]]  # of each parameter, the smallest and the largest value
NEAR = 1e-9  # share of an axis' width by which a cell on the box's edge may miss it


class GridError(Sim2RealError):
    """A grid's axis, fixed value or box is wrong."""


@dataclass(frozen=True)
class Axis:
    """The values that a grid gives to one parameter.

    Args:
        parameter: name in the parameter space, such as `link_mass.torso`.
        values: the cells' values in the parameter's unit, increasing; or leave them out and say
        low: the first of `count` evenly spaced values,
        high: the last of them,
        count: how many, at least 2.

    Raises:
        GridError: values that do not increase or are not finite, or neither `values` nor all of
            the rest.
    """

    parameter: str
    values: tuple[float, ...] = ()
    low: float | None = field(default=None, compare=False)
    high: float | None = field(default=None, compare=False)
    count: int | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        spaced = (self.low, self.high, self.count)
        if bool(self.values) == any(x is not None for x in spaced):
            raise GridError(f"axis {self.parameter}: give either values, or low, high and count")
        if not self.values:
            object.__setattr__(self, "values", self._spaced())
        object.__setattr__(self, "values", tuple(float(v) for v in self.values))
        if not np.isfinite(self.values).all() or (np.diff(self.values) <= 0).any():
            raise GridError(
                f"axis {self.parameter}: values must be finite and increase, "
                f"got {list(self.values)}"
            )

    def _spaced(self) -> tuple[float, ...]:
        if self.low is None or self.high is None or self.count is None:
            raise GridError(
                f"axis {self.parameter}: low={self.low}, high={self.high}, count={self.count}; "
                "give all three"
            )
        if self.count < 2 or not self.low < self.high:
            raise GridError(
                f"axis {self.parameter}: needs low < high and count >= 2, got {self.low:g}, "
                f"{self.high:g} and {self.count}"
            )
        return tuple(np.round(np.linspace(self.low, self.high, self.count), 12).tolist())

    def edges(self) -> np.ndarray:
        """Return the cells' borders, halfway between neighbours, (len(values) + 1,)."""
        values = np.array(self.values)
        if len(values) == 1:
            return np.array([values[0] - 0.5, values[0] + 0.5])
        middle = (values[1:] + values[:-1]) / 2
        return np.concatenate([[2 * values[0] - middle[0]], middle, [2 * values[-1] - middle[-1]]])


class Grid:
    """All combinations of the values of some parameters; the others stay as they are.

    Args:
        axes: each an `Axis`, or a mapping of its arguments.
        fixed: values of parameters without an axis, by name; those not named are neutral.

    Raises:
        GridError: no axis, a parameter twice, or a mapping that makes no axis.
    """

    def __init__(
        self, axes: Sequence[Axis | Mapping[str, Any]], fixed: Mapping[str, float] | None = None
    ) -> None:
        self.axes = tuple(_axis(axis) for axis in axes)
        self.fixed = dict(fixed or {})
        self.names = tuple(axis.parameter for axis in self.axes)
        if not self.axes:
            raise GridError("a grid needs at least one axis")
        for name in self.names:
            if self.names.count(name) > 1 or name in self.fixed:
                raise GridError(f"grid: {name} is given twice; keep one axis or fixed value for it")
        self.shape = tuple(len(axis.values) for axis in self.axes)

    @property
    def size(self) -> int:
        """C, the number of cells."""
        return int(np.prod(self.shape))

    def cells(self) -> np.ndarray:
        """Return the axes' values in every cell, (C, axes); the last axis varies fastest."""
        return np.array(list(itertools.product(*(axis.values for axis in self.axes))))

    def parameters(self, space: ParamSpace) -> tuple[Parameter, ...]:
        """Return the axes' parameters; raises ParameterError for a name that the space lacks."""
        return tuple(space.parameters[space.index(name)] for name in self.names)

    def values(self, space: ParamSpace) -> np.ndarray:
        """Return the point of the space in every cell, (C, P).

        Raises:
            ParameterError: a name that the space lacks, or a value outside what its parameter
                means.
        """
        values = space.points(self.size)
        for name, value in self.fixed.items():
            values[:, space.index(name)] = value
        for column, name in enumerate(self.names):
            values[:, space.index(name)] = self.cells()[:, column]
        return space.validate(values)

    def inside(self, box: Box) -> np.ndarray:
        """Return which cells lie in a box, edges included, (C,) bool; it may lack axes."""
        cells = self.cells()
        inside = np.ones(self.size, bool)
        for column, name in enumerate(self.names):
            low, high = box.get(name, (-np.inf, np.inf))
            slack = NEAR * np.ptp(cells[:, column])
            inside &= (cells[:, column] >= low - slack) & (cells[:, column] <= high + slack)
        return inside


def _axis(axis: Axis | Mapping[str, Any]) -> Axis:
    if isinstance(axis, Axis):
        return axis
    allowed = tuple(Axis.__dataclass_fields__)
    unknown = [key for key in axis if key not in allowed]
    if unknown or "parameter" not in axis:
        raise GridError(
            f"grid: an axis needs parameter and takes {', '.join(allowed)}; got {dict(axis)}"
        )
    arguments: dict[str, Any] = {**axis, "values": tuple(axis.get("values", ()))}
    return Axis(**arguments)
