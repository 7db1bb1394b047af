"""The noise floor: the scatter of a robot's joints between repeats, which no model can remove.

    noise_floor(logs)                   # {"elbow": 0.0034, ...} rad or m, of a single run

Where commands repeat (the same ones for a second, with the same settings), it is the scatter of
where a joint then is whose own command moved: one that holds still remembers for longer from which
side it came. Few moments that are far apart (a step was commanded a row earlier, or the joint swung
freely before) are left out. Where nothing repeats it is what a moment's motion does not explain:
the rest of a cubic through neighbouring rows, while the joint is slow, and never less than what
rounding to counts makes.
"""

import json
from collections.abc import Sequence
from math import comb

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.pairs import scalars
from sim2real.diagnosis.data.recording import powered
from sim2real.diagnosis.data.windows import hunting_rows
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings

ORDER = 4  # of the differences that a cubic leaves
UNIFORM = 12  # 1/12 is the variance of an error that is uniform within one count
SAME = 1e-6  # rad or m: readings closer than this are equal
ONE_COUNT = 1.5  # between one step and two


def noise_floor(logs: Sequence[Log], settings: Settings = DEFAULT) -> dict[str, float]:
    """Return the noise of a single run by joint [rad or m], root mean square.

    Args:
        logs: logs of one robot.
        settings: those of `noise_floor` are used.
    """
    names = list(dict.fromkeys(name for log in logs for name in scalars(log)))
    own = {name: reading_noise(logs, f"qpos.{name}", settings) for name in names}
    repeats = _repeats(logs, names, settings)
    return own | {name: max(scatter, own[name]) for name, scatter in repeats.items()}


def step_of(values: np.ndarray, settings: Settings = DEFAULT) -> float:
    """Return the step between two readings of an encoder, 0 if they are not rounded.

    Of few values that are read again and again it is the smallest step between two of them.
    """
    limits, levels = settings.noise_floor, np.unique(values)
    steps = np.diff(levels)
    steps = steps[steps > SAME]
    if len(steps) < limits.steps_min:
        again = len(values) > limits.steps_min * len(levels)
        return float(steps.min()) if again and steps.size else 0.0
    step = float(np.median(steps[steps < ONE_COUNT * steps.min()]))
    near = steps[steps < step / limits.whole_error]  # of more counts, it may be that far off itself
    whole = np.abs(near / step - np.round(near / step)) < limits.whole_error
    return step if whole.mean() > 1 - settings.inference.level else 0.0


def count_of(logs: Sequence[Log], joint: str, settings: Settings = DEFAULT) -> float:
    """Return the step between two readings of a joint, 0 if they are not rounded."""
    column = f"qpos.{joint}"
    values = [log.column(column)[log.fresh] for log in logs if column in log.columns]
    return step_of(np.concatenate(values), settings)


def rounding(step: float) -> float:
    """Return the root mean square error of rounding to steps of this size."""
    return float(step / np.sqrt(UNIFORM))


def reading_noise(logs: Sequence[Log], column: str, settings: Settings) -> float:
    """Return the noise of one reading of a column, in its unit, root mean square.

    It is what a cubic through neighbouring rows leaves while the joint is slow, and at least what
    rounding makes. Rows in which a loop hunts count only where there are no others.
    """
    episodes = [
        part
        for log in logs
        if column in log.columns
        for part in log.episodes()
        if part.fresh.sum() > ORDER
    ]
    if not episodes:
        return 0.0
    parts = [part.column(column)[part.fresh] for part in episodes]
    step = step_of(np.concatenate(parts), settings)
    rests = np.concatenate([np.diff(q, ORDER) for q in parts])
    moves = np.concatenate([np.abs(q[ORDER:] - q[:-ORDER]) for q in parts])
    hunts = [hunting_rows(part)[part.fresh] for part in episodes]
    calm = np.concatenate([~rows[ORDER // 2 : -ORDER // 2] for rows in hunts])
    rests, moves = (rests[calm], moves[calm]) if calm.any() else (rests, moves)
    slow = rests[moves <= np.quantile(moves, settings.noise_floor.slow_share)]
    variances = comb(2 * ORDER, ORDER)  # of a reading, in that of its difference
    noise = np.sqrt(np.mean(slow**2) / variances) if slow.size else 0.0
    return float(max(noise, rounding(step)))


def _repeats(logs: Sequence[Log], names: Sequence[str], settings: Settings) -> dict[str, float]:
    """The scatter of each joint over moments whose commands agree for a second before."""
    groups: dict[tuple[str, bytes], list[tuple[int, float, np.ndarray]]] = {}
    number = 0
    for log in logs:
        registers = json.dumps(log.settings, sort_keys=True)
        for part in log.episodes():
            number += 1
            for when, key, q in _moments(part, names, settings):
                groups.setdefault((registers, key), []).append((number, when, q))
    squares, freedom = [], []
    for moments in groups.values():
        values = np.array(_apart(moments, settings.bootstrap.block_s))  # (n, M)
        if len(values) > 1:
            squares.append(((values - values.mean(axis=0)) ** 2).sum(axis=0))
            freedom.append(len(values) - 1)
    found = {}
    for name, square in zip(names, np.array(squares).T, strict=False):
        known = np.isfinite(square)
        number, own = np.array(freedom)[known], square[known]
        scatter = np.sqrt(own / number)
        if not scatter.size:
            continue
        counts = settings.preflight.counts * count_of(logs, name, settings)
        far = max(settings.preflight.sigmas * float(np.median(scatter)), counts)
        near = scatter <= far
        if number[near].sum() >= settings.preflight.rows_min:
            found[name] = float(np.sqrt(own[near].sum() / number[near].sum()))
    return found


def _moments(
    part: Log, names: Sequence[str], settings: Settings
) -> list[tuple[float, bytes, np.ndarray]]:
    """Moments of an episode: when, the commands of the second before as a key, and positions."""
    sent = [part.column(f"ctrl.{name}") for name in part.actuators]
    ctrl = np.column_stack([*sent, *(powered(part, name) for name in part.actuators)])
    history, every, found = settings.bootstrap.block_s, settings.noise_floor.every_s, []
    count = round(2 * history / every)  # of commands that are compared: twice between moments
    for when in np.arange(np.ceil((part.time[0] + history) / every) * every, part.time[-1], every):
        ticks = np.linspace(when - history, when, count)
        rows = np.maximum(np.searchsorted(part.time, ticks + TINY, side="right") - 1, 0)
        key = np.round(ctrl[rows] / settings.preflight.same_command).astype(np.int64).tobytes()
        row = int(rows[-1])
        if hunting_rows(part)[rows[0] : row + 1].any():
            continue
        sent = zip(part.actuators, ctrl[rows].T, strict=False)
        moved = {name: np.ptp(values) > settings.preflight.moved for name, values in sent}
        q = [
            part.column(f"qpos.{name}")[row] if moved.get(name, any(moved.values())) else np.nan
            for name in names
        ]
        found.append((float(when), key, np.array(q)))
    return found


def _apart(moments: Sequence[tuple[int, float, np.ndarray]], history: float) -> list[np.ndarray]:
    """Of moments that lie within the history [s] of each other, keep the first."""
    kept: list[tuple[int, float, np.ndarray]] = []
    for moment in moments:
        if not kept or moment[0] != kept[-1][0] or moment[1] - kept[-1][1] > history:
            kept.append(moment)
    return [q for *_, q in kept]
