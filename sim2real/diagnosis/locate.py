"""Where the gap lies: which joint, and at which kind of moment.

    where = locate(gaps, floors, models, rng=np.random.default_rng(0))
    where[0].joint, where[0].regimes            # joints, the largest share first
    bands(gaps, floors)                         # the same by frequency

A share is a part of a joint's squared error. A kind of moment is named where its share is larger
than its part of the time, by more than a block bootstrap leaves to chance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
from scipy.signal import periodogram

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.recording import episode_rows
from sim2real.diagnosis.data.regimes import Kind, regimes
from sim2real.diagnosis.data.replay import Gap
from sim2real.diagnosis.evidence import Band
from sim2real.diagnosis.schema import JointGap, Regime
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Locating, Settings


def locate(
    gaps: Sequence[Gap],
    floors: np.ndarray,
    models: Sequence[mujoco.MjModel],
    after: Sequence[Gap] = (),
    *,
    rng: np.random.Generator,
    scale: np.ndarray | float = 1.0,
    settings: Settings = DEFAULT,
) -> tuple[JointGap, ...]:
    """Return the gap by joint, the largest share first.

    Args:
        gaps: each log with its replay in the model as given, all of the same M joints.
        floors: noise of each joint, (M,); what is left of its squared error above it counts.
        models: the model of each log.
        after: each log with its replay in the corrected model.
        rng: the bootstrap's random generator.
        scale: what a joint's error is divided by, where rad and m have to meet, (M,).
        settings: those of `locating`, `regimes`, `dataset` and `bootstrap` are used.
    """
    error = _error(gaps)
    before, left = (np.mean(_error(some or gaps) ** 2, axis=0) for some in (gaps, after))  # (M,)
    power = np.maximum(before - floors**2, 0.0) / scale**2
    shares = power / max(float(power.sum()), TINY_SQUARE)
    found = []
    for i, joint in enumerate(gaps[0].joints):
        named = _regimes([gap.log for gap in gaps], models, joint, error[:, i], rng, settings)
        rest = float(np.sqrt(left[i])) if after else None
        found.append(JointGap(joint, float(shares[i]), float(np.sqrt(before[i])), rest, named))
    return tuple(sorted(found, key=lambda gap: -gap.share))


def bands(
    gaps: Sequence[Gap],
    floors: np.ndarray,
    after: Sequence[Gap] = (),
    settings: Locating = DEFAULT.locating,
) -> tuple[Band, ...]:
    """Return the gap by joint and band of frequencies, as far as the rows can tell.

    Args:
        gaps: each log with its replay in the model as given.
        floors: white noise of each joint, (M,).
        after: each log with its replay in the corrected model; as before if none.
        settings: the edges of the bands.
    """
    old, nyquist = _spectrum(gaps, settings.edges_hz)
    new = _spectrum(after, settings.edges_hz)[0] if after else old
    found = []
    for i, joint in enumerate(gaps[0].joints):
        for k, (low, high) in enumerate(pairwise(settings.edges_hz)):
            if low < nyquist:
                top = min(high, nyquist)
                noise = float(floors[i] * np.sqrt((top - low) / nyquist))
                sizes = (float(np.sqrt(power[k, i])) for power in (old, new))
                found.append(Band(joint, low, top, *sizes, floor=noise))
    return tuple(found)


def as_gaps(data: Data, error: np.ndarray) -> list[Gap]:
    """Return each log's compared rows with what was simulated, from held-out errors (W, T, M)."""
    found, names = [], tuple(joint.name for joint in data.joints)
    for number, log in enumerate(data.logs):
        own = np.array([window.log == number for window in data.windows])
        parts = [w.first + np.flatnonzero(w.usable) for w in data.windows if w.log == number]
        part = replace(log, columns={n: v[np.concatenate(parts)] for n, v in log.columns.items()})
        measured, off = (values[own][data.mask[own]] for values in (data.measured, error))
        found.append(Gap(part, names, measured, measured + off * data.scale))
    return found


def _error(gaps: Sequence[Gap]) -> np.ndarray:
    """Return simulated minus measured over all logs, (T, M)."""
    return np.concatenate([gap.simulated - gap.measured for gap in gaps])


def _regimes(
    logs: Sequence[Log],
    models: Sequence[mujoco.MjModel],
    joint: str,
    error: np.ndarray,
    rng: np.random.Generator,
    settings: Settings,
) -> tuple[Regime, ...]:
    """Return the kinds of moments that hold more than their part of a joint's error, (T,).

    They are the best of each group.
    """
    kinds: dict[tuple[str, str], np.ndarray] = {}
    block, start, count = np.zeros(len(error), int), 0, 0
    for log, model in zip(logs, models, strict=True):
        own = slice(start, start := start + len(log))
        for group, name, rows in _kinds(log, model, joint, settings):
            kinds.setdefault((group, name), np.zeros(len(error), bool))[own] = rows
        pieces = np.column_stack([log.episode, log.time // settings.bootstrap.block_s])
        block[own] = count + np.unique(pieces, axis=0, return_inverse=True)[1]
        count = int(block[start - 1]) + 1
    square, draws, limits = error**2, settings.bootstrap.draws, settings.locating
    weights = rng.multinomial(count, np.full(count, 1 / count), draws)  # (D, blocks)
    whole = np.maximum(weights @ np.bincount(block, square, count), TINY_SQUARE)
    best: dict[str, tuple[float, Regime]] = {}  # by group: how much more, and which
    for (group, name), rows in kinds.items():
        shares = weights @ np.bincount(block[rows], square[rows], count) / whole
        low = float(np.quantile(shares, settings.inference.level))
        share, time = float(square[rows].sum() / max(square.sum(), TINY_SQUARE)), rows.mean()
        largest = group not in best or share > best[group][1].share
        if low > limits.lift * time and share > limits.share_min and largest:
            best[group] = (share - time, Regime(name, share))
    return tuple(regime for _, regime in sorted(best.values(), key=lambda one: -one[0]))


def _kinds(log: Log, model: mujoco.MjModel, joint: str, settings: Settings) -> Iterator[Kind]:
    """The kinds of moments of a log, its episodes and itself among them."""
    yield from regimes(log, model, joint, settings)
    name = log.path.stem if log.path else "the log"
    numbers = np.unique(log.episode)
    for number in numbers:
        label = name if len(numbers) == 1 else f"{name}, episode {number}"
        yield "episode", label, log.episode == number


def _spectrum(gaps: Sequence[Gap], edges: Sequence[float]) -> tuple[np.ndarray, float]:
    """Mean squared error in each band, (bands, M), and the highest frequency that rows show."""
    power, rows, nyquist = np.zeros((len(edges) - 1, len(gaps[0].joints))), 0, float(edges[-1])
    for gap in gaps:
        for own in episode_rows(gap.log):
            time, error = gap.log.time[own], gap.simulated[own] - gap.measured[own]
            dt = float(np.median(np.diff(time)))
            clock = np.arange(time[0], time[-1] + dt / 2, dt)
            evenly = np.column_stack([np.interp(clock, time, values) for values in error.T])
            rates, lines = periodogram(evenly, 1 / dt, detrend=False, scaling="spectrum", axis=0)  # type: ignore[arg-type]
            band = np.digitize(rates, edges[1:-1])
            power += [len(clock) * lines[band == k].sum(axis=0) for k in range(len(power))]
            rows, nyquist = rows + len(clock), min(nyquist, 1 / (2 * dt))
    return power / max(rows, 1), nyquist
