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
from collections.abc import Iterator, Sequence
from math import comb

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.pairs import scalars
from sim2real.diagnosis.data.recording import HUNTING, is_flagged, powered
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings

ORDER = 4  # of the differences that a cubic leaves
UNIFORM = 12  # 1/12 is the variance of an error that is uniform within one count
SAME = 1e-6  # rad or m: readings closer than this are equal
MOMENTS = 10  # looked at in the time of a block; commands are compared twice as often
ONE_COUNT = 1.5  # between one step and two


def noise_floor(logs: Sequence[Log], settings: Settings = DEFAULT) -> dict[str, float]:
    """Return the noise of a single run of a robot by joint [rad or m], root mean square."""
    names = list(dict.fromkeys(name for log in logs for name in scalars(log)))
    own = {name: reading_noise(logs, f"qpos.{name}", settings) for name in names}
    repeats = _repeats(logs, names, settings)
    return own | {name: max(scatter, own[name]) for name, scatter in repeats.items()}


def step_of(values: np.ndarray, settings: Settings = DEFAULT) -> float:
    """Return the step between two readings of an encoder, 0 if they are not rounded.

    Of rounded readings some are equal, and all differ by whole steps.
    """
    error, levels = settings.noise_floor.whole_error, np.unique(values)
    steps = np.diff(levels)
    steps = steps[steps > SAME]
    if len(levels) == len(values) or not steps.size:
        return 0.0
    step = float(np.median(steps[steps < ONE_COUNT * steps.min()]))
    near = steps[steps < step / error]  # of more counts, it may be that far off itself
    whole = np.abs(near / step - np.round(near / step)) < error
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

    Rows in which a loop hunts count only where there are no others.
    """
    own = [part for log in logs if column in log.columns for part in log.episodes()]
    episodes = [part for part in own if part.fresh.sum() > ORDER]
    if not episodes:
        return 0.0
    parts = [part.column(column)[part.fresh] for part in episodes]
    rests = np.concatenate([np.diff(q, ORDER) for q in parts])
    moves = np.concatenate([np.abs(q[ORDER:] - q[:-ORDER]) for q in parts])
    hunts = [is_flagged(part, HUNTING)[part.fresh][ORDER // 2 : -ORDER // 2] for part in episodes]
    calm = ~np.concatenate(hunts)
    rests, moves = (rests[calm], moves[calm]) if calm.any() else (rests, moves)
    slow = rests[moves <= np.quantile(moves, settings.noise_floor.slow_share)]
    variances = comb(2 * ORDER, ORDER)  # of a reading, in that of its difference
    noise = np.sqrt(np.mean(slow**2) / variances)
    return float(max(noise, rounding(step_of(np.concatenate(parts), settings))))


def _repeats(logs: Sequence[Log], names: Sequence[str], settings: Settings) -> dict[str, float]:
    """Return the scatter of each joint over moments whose commands agree for a second before."""
    limits = settings.preflight
    groups: dict[tuple[str, bytes], list[np.ndarray]] = {}
    for log in logs:
        registers = json.dumps(log.settings, sort_keys=True)
        for part in log.episodes():
            last = dict[bytes, float]()  # when each key's last moment was; others are too near it
            for when, key, q in _moments(part, names, settings):
                if when - last.get(key, -np.inf) > settings.bootstrap.block_s:
                    last[key] = when
                    groups.setdefault((registers, key), []).append(q)
    moments = [np.array(own) for own in groups.values() if len(own) > 1]  # (n, M)
    squares = np.array([own.var(axis=0) * len(own) for own in moments])
    freedom = np.array([len(own) - 1 for own in moments])
    found = {}
    for name, square in zip(names, squares.T, strict=False):
        known = np.isfinite(square)
        own, free = square[known], freedom[known]
        if own.size:
            scatter = np.sqrt(own / free)
            counts = limits.counts * count_of(logs, name, settings)
            near = scatter <= max(limits.sigmas * float(np.median(scatter)), counts)
            if free[near].sum() >= limits.rows_min:
                found[name] = float(np.sqrt(own[near].sum() / free[near].sum()))
    return found


def _moments(
    part: Log, names: Sequence[str], settings: Settings
) -> Iterator[tuple[float, bytes, np.ndarray]]:
    """Yield moments of an episode: when, the commands of a second before as a key, positions."""
    sent = [part.column(f"ctrl.{name}") for name in part.actuators]
    ctrl = np.column_stack([*sent, *(powered(part, name) for name in part.actuators)])
    history, time, hunts = settings.bootstrap.block_s, part.time, is_flagged(part, HUNTING)
    every, missing = history / MOMENTS, np.full(len(time), np.nan)
    q = np.column_stack([part.columns.get(f"qpos.{name}", missing) for name in names])
    for when in np.arange(np.ceil((time[0] + history) / every) * every, time[-1], every):
        ticks = np.linspace(when - history, when, 2 * MOMENTS)
        rows = np.maximum(np.searchsorted(time, ticks + TINY, side="right") - 1, 0)
        if not hunts[rows[0] : rows[-1] + 1].any():
            key = np.round(ctrl[rows] / settings.preflight.same_command).astype(np.int64).tobytes()
            sizes = np.ptp(ctrl[rows], axis=0) > settings.preflight.moved
            moved = dict(zip(part.actuators, sizes, strict=False))
            known = [moved.get(name, any(moved.values())) for name in names]
            yield float(when), key, np.where(known, q[rows[-1]], np.nan)
