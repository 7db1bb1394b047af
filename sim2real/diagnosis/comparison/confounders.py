"""What may differ between two sets of logs without the robot having changed.

    found = confounders(made, before, after, remounted=True)
    found.listed, found.excused, found.supply

Temperature makes grease thin and copper resist, in all joints alike; a robot that was mounted anew
stands a little askew; a supply has the voltage that it has. Each is asked for and shown. What
temperature and mounting explain is put down to them; a supply that the servos measured to be
another is a change that needs no statistics.

    pieces, moved = excuse(first, made, (before, after), found)

A tenth less friction in all joints moves a robot by more than a few per cent of it in one, and its
straight line is wrong by as much as what is looked for. So the side after is simulated once more
with what was put down to other things, and only what that leaves is explained by straight lines.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.answer import Confounder
from sim2real.diagnosis.comparison.permuted import Prior, explain
from sim2real.diagnosis.comparison.pieces import Pieces, contrasts
from sim2real.diagnosis.comparison.prepared import Prepared
from sim2real.diagnosis.comparison.response import FRICTION, Column, errors
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY

DRIVES = ("motor_strength", "position_gain")  # what a motor's copper and magnets are seen as
THERMAL = (*FRICTION, "motor_strength")  # grease thins, copper resists, magnets weaken
LITTLE = 2.0  # standard deviations that are put down to temperature where it is the same: 95 %
COPPER = 0.004  # 1/K by which it resists more: a motor has as much less strength
KELVIN = 1.0  # K: servos report whole degrees, so medians this close are equal
TICK = 1e-3  # s between a servo's readings: sessions differ by up to one, by half of it in the mean
WORSE = 0.1  # of the squares: clocks take some of what a change mends, and are not in them
ROUNDS = 2  # the second mends what a straight line missed; a third changes no verdict
MOUNTING, SUPPLY = "gravity_tilt", "supply_voltage"


class Confounded(NamedTuple):
    """The confounders, and what they say of P columns and of the clocks of M joints."""

    listed: tuple[Confounder, ...]
    excused: Sequence[int]  # columns that temperature or mounting may have changed
    little: Sequence[int]  # columns that temperature may have changed a little
    known: Sequence[int]  # columns that a sensor says have changed
    ruled_out: Sequence[int]  # columns that a sensor says are as before
    least: np.ndarray  # (P,) size of a change of each column below which it may be temperature
    prior: Prior  # (P + M,) of what temperature does, and of the joints' clocks
    supply: float | None  # relative change of the measured voltage; None: none, or not logged

    @property
    def aside(self) -> tuple[int, ...]:
        """The columns that something else may have changed."""
        return (*self.excused, *self.known, *self.little)


def confounders(
    made: Prepared, before: Collection[int], after: Collection[int], remounted: bool
) -> Confounded:
    """Look at temperature, supply and mounting of the logs of two sides.

    `remounted` says whether the robot may have been mounted anew in between.
    """
    data, columns = made.data, made.response.columns
    limits = data.settings.compared

    def named(*names: str) -> list[int]:
        return [k for k, column in enumerate(columns) if column.option.name in names]

    thermal, tilts, supplies = named(*THERMAL), named(MOUNTING), named(SUPPLY)
    common = [k for k in thermal if columns[k].option.shared]
    excused, little, known, same = [], [], [], []
    was, now = (_median(data, "temperature", side) for side in (before, after))
    rise = None if was is None or now is None else now - was
    warmer = max(limits.unknown_warmer if rise is None else abs(rise), KELVIN)
    if warmer == KELVIN and rise is not None:
        little = common
        warm = "close enough: next to nothing is put down to it"
    else:
        excused += common or thermal
        warm = (
            "log temperature.<actuator>: what all joints have in common may be temperature"
            if rise is None
            else "differ: what all joints have in common is put down to temperature"
        )
        if not common:
            warm += "; this robot has one joint, so friction and strength may be temperature"
    supply, (low, high) = None, (_median(data, "voltage", side) for side in (before, after))
    if low is None or high is None:
        volts = "log voltage.<actuator>: a weaker supply shows in the motion alone"
    elif abs(high / low - 1) >= limits.same_voltage:
        supply, known = high / low - 1, supplies
        volts = "another supply, as the servos measured it"
    else:
        same = supplies
        volts = "the same supply"
    if tilts and remounted:
        excused += tilts
        stands = "may be another (remounted=false if not): a small tilt is put down to it"
    else:
        stands = "is the same" if tilts else "cannot show: gravity does not act on what moves"
    listed = (
        Confounder("temperature", was, now, "°C", warm),
        Confounder("supply voltage", low, high, "V", volts),
        Confounder("mounting", None, None, "", stands),
    )
    own = _sizes(columns, made.friction)
    count, clocks = len(columns), np.full(len(data.joints), TICK / 2)
    prior = Prior(np.zeros(count + len(clocks)), np.append(np.full(count, np.inf), clocks))
    for k in common:
        friction = columns[k].option.name in FRICTION
        size = own[k] * (limits.warm_friction if friction else COPPER)
        prior.mean[k], prior.spread[k] = -(rise or 0.0) * size, max(warmer * size, TINY)
    least = limits.unequal * warmer * own
    return Confounded(listed, excused, little, known, same, least, prior, supply)


def _sizes(columns: Sequence[Column], friction: Mapping[int, float]) -> np.ndarray:
    """Return how much temperature acts on in each column: its joint's friction, 1 of a drive, (P,).

    What of a joint's friction is dry and what is viscous, few motions tell: a share of both may
    show as either, as if they were equal at 1 rad/s (or 1 m/s).
    """
    whole: dict[str | None, float] = {}
    for k, size in friction.items():
        place = columns[k].option.place
        whole[place] = whole.get(place, 0.0) + size
    whole[None] = float(np.mean(list(whole.values()))) if whole else 0.0  # shared by all joints
    options = [column.option for column in columns]
    return np.array(
        [
            whole.get(o.place, 0.0) if o.name in FRICTION else float(o.name in DRIVES)
            for o in options
        ]
    )


def _median(data: Data, kind: str, side: Collection[int]) -> float | None:
    """Return the median over all actuators and rows of a side; None where not logged."""
    values = [
        values
        for number in side
        for name, values in data.logs[number].columns.items()
        if name.startswith(f"{kind}.")
    ]
    return float(np.median(np.concatenate(values))) if values else None


def excuse(
    first: Pieces, made: Prepared, sides: tuple[Collection[int], Collection[int]], found: Confounded
) -> tuple[Pieces, dict[int, float]]:
    """Simulate the side after with what is put down to other things.

    Args:
        first: the pieces of the errors as they are.
        made: the replayed logs.
        sides: the logs before and those after.
        found: the columns that something else may have changed, and what is known of them.

    Returns:
        The pieces that are left, and what was simulated of each column.
    """
    columns, response, prior = list(found.aside), made.response, found.prior
    best, moved = first, dict.fromkeys(columns, 0.0)
    later = np.array([i for i, w in enumerate(made.data.windows) if w.log in sides[1]], int)
    spread, middle = prior.spread.copy(), prior.mean[columns]
    reach = np.where(np.isin(columns, found.little), LITTLE * spread[columns], np.inf)
    spread[columns] = np.minimum(spread[columns], [response.columns[k].typical for k in columns])
    for _ in range(ROUNDS if columns else 0):
        left = Prior(prior.after(moved).mean, spread)
        more = explain(best, [*columns, *best.clocks], left)[: len(columns)]
        whole = np.clip(list(moved.values()) + more, middle - reach, middle + reach)
        tried = dict(zip(columns, whole.tolist(), strict=True))
        error = made.error.copy()
        error[later] = errors(made.simulator, response.moved(made.watch, tried), later)
        pieces = contrasts(made, error, *sides)
        if np.sum(pieces.rms**2) > (1 + WORSE) * np.sum(best.rms**2):
            break
        best, moved = pieces, tried
    return best, moved
