"""The noise floor: how far a robot's joints are from themselves, which no model can mend.

    noise_floor(logs)                   # {"elbow": 0.0034, ...} rad or m, of a single run

Where commands repeat (the same ones for a second, with the same settings), it is the scatter of
where a joint then is whose own command moved: one that holds still remembers for longer from which
side it came. Few moments that are far apart (a step was commanded a row earlier, or the joint swung
freely before) are left out. Where nothing repeats it is what a moment's motion does not explain:
the rest of a cubic through neighbouring rows, while the joint is slow, and never less than what
rounding to counts makes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from hardware.log import Log

HISTORY = 1.0  # s of commands that must agree
TICKS = 20  # at which they are compared in that time
EVERY = 0.1  # s between the moments that are looked at
SAME = 2e-3  # rad or m: commands this near count as the same
MOVED = 0.02  # rad or m: a command that moves less in that time holds still
FEWEST = 20  # repeats below which scatter is not trusted
FOURTH = 70  # variances in a fourth difference: 1 + 16 + 36 + 16 + 1
APART = 5.0, 3.0  # times the middle scatter, and counts, beyond which moments are not repeats
SLOW = 0.3  # share of the rows that count as slow


def noise_floor(logs: Sequence[Log]) -> dict[str, float]:
    """Return the noise of a single run by joint [rad or m], root mean square."""
    names = list(dict.fromkeys(name for log in logs for name in _positions(log)))
    own = {name: _rest(logs, name) for name in names}
    return own | {name: max(scatter, own[name]) for name, scatter in _repeats(logs, names).items()}


def step_of(values: np.ndarray) -> float:
    """Return the step between two readings of an encoder, 0 if they are not rounded."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-6]
    if len(steps) < 5:
        return 0.0
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    near = steps[steps < 50 * step]
    whole = np.abs(near / step - np.round(near / step)) < 0.02
    return step if whole.mean() > 0.95 else 0.0


def _positions(log: Log) -> list[str]:
    return [name for name in log.joints if f"qpos.{name}" in log.columns]


def _rest(logs: Sequence[Log], joint: str) -> float:
    """What a cubic through neighbouring rows leaves of a slow joint's position, or a count's."""
    parts = [
        part.column(f"qpos.{joint}")
        for log in logs
        if f"qpos.{joint}" in log.columns
        for part in log.episodes()
        if len(part) >= 5
    ]
    if not parts:
        return 0.0
    step = step_of(np.concatenate(parts))
    rests = np.concatenate([np.diff(q, 4) for q in parts])
    moves = np.concatenate([np.abs(q[4:] - q[:-4]) for q in parts])
    slow = rests[moves <= np.quantile(moves, SLOW)]
    noise = np.sqrt(np.mean(slow**2) / FOURTH) if slow.size else 0.0
    return float(max(noise, step / np.sqrt(12)))


def _repeats(logs: Sequence[Log], names: Sequence[str]) -> dict[str, float]:
    """The scatter of each joint over moments whose commands agree for a second before."""
    groups: dict[tuple[str, bytes], list[tuple[int, float, np.ndarray]]] = {}
    number = 0
    for log in logs:
        settings = json.dumps(log.settings, sort_keys=True)
        for part in log.episodes():
            number += 1
            for when, key, q in _moments(part, names):
                groups.setdefault((settings, key), []).append((number, when, q))
    squares, freedom = [], []
    for moments in groups.values():
        values = np.array(_apart(moments))  # (n, M)
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
        far = max(APART[0] * float(np.median(scatter)), APART[1] * _count(logs, name))
        near = scatter <= far
        if number[near].sum() >= FEWEST:
            found[name] = float(np.sqrt(own[near].sum() / number[near].sum()))
    return found


def _count(logs: Sequence[Log], joint: str) -> float:
    """Return the step between two readings of a joint, 0 if they are not rounded."""
    column = f"qpos.{joint}"
    return step_of(np.concatenate([log.column(column) for log in logs if column in log.columns]))


def _moments(part: Log, names: Sequence[str]) -> list[tuple[float, bytes, np.ndarray]]:
    """Moments of an episode: when, the commands of the second before as a key, and positions."""
    ctrl = np.column_stack([part.column(f"ctrl.{name}") for name in part.actuators])
    on = [part.columns.get(f"torque.{name}", np.ones(len(part))) for name in part.actuators]
    ctrl = np.column_stack([ctrl, *on])
    whole = [np.arange(np.ceil((part.time[0] + HISTORY) / EVERY) * EVERY, part.time[-1], EVERY)]
    found = []
    for when in whole[0]:
        ticks = np.linspace(when - HISTORY, when, TICKS)
        rows = np.maximum(np.searchsorted(part.time, ticks + 1e-9, side="right") - 1, 0)
        key = np.round(ctrl[rows] / SAME).astype(np.int64).tobytes()
        row = int(rows[-1])
        moved = {n: np.ptp(c) > MOVED for n, c in zip(part.actuators, ctrl[rows].T, strict=False)}
        q = [
            part.column(f"qpos.{name}")[row] if moved.get(name, any(moved.values())) else np.nan
            for name in names
        ]
        found.append((float(when), key, np.array(q)))
    return found


def _apart(moments: Sequence[tuple[int, float, np.ndarray]]) -> list[np.ndarray]:
    """Of moments that lie within a second of each other, keep the first."""
    kept: list[tuple[int, float, np.ndarray]] = []
    for moment in moments:
        if not kept or moment[0] != kept[-1][0] or moment[1] - kept[-1][1] > HISTORY:
            kept.append(moment)
    return [q for *_, q in kept]
