"""What may differ between two sets of logs without the robot having changed.

    found = confounders(made, before, after, remounted=True)
    found.listed, found.excused, found.supply

Temperature makes grease thin and copper resist, in all joints alike; a robot that was mounted anew
stands a little askew; a supply has the voltage that it has. Each is asked for and shown. What
temperature and mounting explain is put down to them; a supply that the servos measured to be
another is a change that needs no statistics.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.answer import Confounder
from sim2real.diagnosis.comparison.permuted import Prior
from sim2real.diagnosis.comparison.prepared import Prepared
from sim2real.diagnosis.comparison.response import FRICTION, Column
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY, Compared

DRIVES = ("motor_strength", "position_gain")  # what a motor's copper and magnets are seen as
MOUNTING, SUPPLY = "gravity_tilt", "supply_voltage"


class Found(NamedTuple):
    """The confounders, what is put down to them, and the supply's measured change."""

    listed: tuple[Confounder, ...]
    excused: tuple[int, ...]  # columns
    little: tuple[int, ...]  # columns that temperature may have changed a little
    ruled_out: tuple[int, ...]  # columns that a sensor says are as before
    least: np.ndarray  # (P,) size of a change of each column below which it may be temperature
    prior: Prior  # (P + M,) of what temperature does, and of the joints' clocks
    supply: float | None  # relative change of the measured voltage; None: none, or not logged


def confounders(
    made: Prepared, before: Collection[int], after: Collection[int], remounted: bool
) -> Found:
    """Look at temperature, supply and mounting.

    Args:
        made: all logs, and what may change.
        before: the logs of the first side.
        after: those of the second.
        remounted: whether the robot may have been mounted anew in between.
    """
    data, columns, friction = made.data, made.response.columns, made.friction
    limits = data.settings.compared
    warm = _medians(data, "temperature", before, after)
    volts = _medians(data, "voltage", before, after)
    listed, excused = [], []
    free, clocks = np.full(len(columns), np.inf), np.full(len(data.joints), limits.clock)
    prior = Prior(np.zeros(len(free) + len(clocks)), np.concatenate([free, clocks]))
    was, now = warm
    known = None not in warm
    warmer = limits.unknown_warmer if was is None or now is None else abs(now - was)
    alike = known and warmer <= limits.same_temperature
    thermal = [
        k for k, c in enumerate(columns) if c.option.shared and c.option.name in limits.thermal
    ]
    rise = 0.0 if was is None or now is None else now - was
    for k in thermal:
        size = _per_kelvin(columns, k, friction, limits)
        spread = max(warmer, limits.same_temperature) * size
        prior.mean[k], prior.spread[k] = -rise * size, max(spread, TINY)
    least = _least(columns, max(warmer, limits.same_temperature), friction, limits)
    if alike:
        text = "close enough: next to nothing is put down to it"
    else:
        excused += thermal
        text = (
            "differ: what all joints have in common is put down to temperature"
            if known
            else "log temperature.<actuator>: what all joints have in common may be temperature"
        )
        if not excused:
            text += "; this robot has one joint, so friction and strength may be temperature"
            excused += [k for k, c in enumerate(columns) if c.option.name in limits.thermal]
    listed.append(Confounder("temperature", *warm, "°C", text))
    change, same = None, []
    low, high = volts
    if low is None or high is None:
        text = "log voltage.<actuator>: a weaker supply shows in the motion alone"
    elif abs(high / low - 1) >= limits.same_voltage:
        change = high / low - 1
        text = "another supply, as the servos measured it"
    else:
        text = "the same supply"
        same = [k for k, c in enumerate(columns) if c.option.name == SUPPLY]
    listed.append(Confounder("supply voltage", *volts, "V", text))
    tilts = [k for k, c in enumerate(columns) if c.option.name == MOUNTING]
    if tilts and remounted:
        excused += tilts
        text = "may be another (remounted=false if not): a small tilt is put down to it"
    else:
        text = "is the same" if tilts else "cannot show: gravity does not act on what moves"
    listed.append(Confounder("mounting", None, None, "", text))
    little = tuple(thermal) if alike else ()
    return Found(tuple(listed), tuple(excused), little, tuple(same), least, prior, change)


def _least(
    columns: Sequence[Column], warmer: float, friction: Mapping[int, float], limits: Compared
) -> np.ndarray:
    """Return the size below which a change of each column may be temperature, (P,).

    What of a joint's friction is dry and what is viscous, few motions tell: a share of both may
    show as either, as if they were equal at 1 rad/s (or 1 m/s).
    """
    least = np.zeros(len(columns))
    whole: dict[str | None, float] = {}
    for k, size in friction.items():
        place = columns[k].option.place
        whole[place] = whole.get(place, 0.0) + size
    mean = float(np.mean(list(whole.values()))) if whole else 0.0
    for k, column in enumerate(columns):
        if column.option.name in FRICTION:
            own = mean if column.option.shared else whole.get(column.option.place, 0.0)
            least[k] = limits.unequal * warmer * own
        elif column.option.name in DRIVES:
            least[k] = limits.unequal * warmer
    return least


def _per_kelvin(
    columns: Sequence[Column], column: int, friction: Mapping[int, float], limits: Compared
) -> float:
    """Return how much of what all joints share goes with a kelvin, in the column's unit.

    What of the friction is dry and what is viscous, few motions tell: either may lose a share of
    both, as if they were equal at 1 rad/s (or 1 m/s).
    """
    if columns[column].option.name not in FRICTION:
        return limits.warm_strength
    every = [
        [size for k, size in friction.items() if columns[k].option.name == name]
        for name in FRICTION
    ]
    return limits.warm_friction * sum(float(np.mean(own)) for own in every if own)


def _medians(
    data: Data, kind: str, before: Collection[int], after: Collection[int]
) -> tuple[float | None, float | None]:
    """Return the medians over all actuators and rows of both sides; None where not logged."""
    found = []
    for side in (before, after):
        values = [
            values
            for number in side
            for name, values in data.logs[number].columns.items()
            if name.startswith(f"{kind}.")
        ]
        found.append(float(np.median(np.concatenate(values))) if values else None)
    return found[0], found[1]
