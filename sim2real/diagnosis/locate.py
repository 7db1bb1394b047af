"""Where the gap lies: which joint, and at which kind of moment.

    where = locate(gaps, noise_floor(logs), models, rng=np.random.default_rng(0))
    where[0].joint, where[0].regimes            # joints, the largest share first
    bands(gaps, floor)                          # the same by frequency

A share is a part of a joint's squared error. A kind of moment is named where its share is larger
than its part of the time, by more than a block bootstrap leaves to chance.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.signal import periodogram

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.regimes import regimes
from sim2real.diagnosis.data.replay import Gap
from sim2real.diagnosis.evidence import Band
from sim2real.diagnosis.schema import JointGap, Regime
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Locating, Settings


class _Cell(NamedTuple):
    """A kind of moment of one joint."""

    group: str  # such as "speed"
    name: str  # such as "fast"
    share: float  # of the joint's squared error
    low: float  # the least that it may be
    time: float  # share of the rows


def locate(
    gaps: Sequence[Gap],
    floor: Mapping[str, float],
    models: Sequence[mujoco.MjModel],
    after: Sequence[Gap] = (),
    *,
    rng: np.random.Generator,
    scale: Mapping[str, float] | None = None,
    settings: Settings = DEFAULT,
) -> tuple[JointGap, ...]:
    """Return the gap by joint, the largest share first.

    Args:
        gaps: each log with its replay in the model as given.
        floor: noise of each joint; what is left of its squared error above it counts.
        models: the model of each log.
        after: each log with its replay in the corrected model.
        rng: the bootstrap's random generator.
        scale: what a joint's error is divided by, where rad and m have to meet; 1 if not given.
        settings: those of `locating`, `regimes`, `dataset` and `bootstrap` are used.
    """
    joints = list(dict.fromkeys(joint for gap in gaps for joint in gap.joints))
    old = {joint: _errors(gaps, joint) for joint in joints}
    new = {joint: _errors(after, joint) for joint in joints} if after else {}
    power = {
        joint: max(float(np.mean(e**2)) - floor.get(joint, 0.0) ** 2, 0.0)
        / (scale or {}).get(joint, 1.0) ** 2
        for joint, e in old.items()
    }
    total = sum(power.values())
    where = [
        JointGap(
            joint,
            power[joint] / total if total > 0 else 0.0,
            _rms(old[joint]),
            _rms(new[joint]) if joint in new else None,
            _named(_cells(gaps, models, joint, old[joint], rng, settings), settings.locating),
        )
        for joint in joints
    ]
    return tuple(sorted(where, key=lambda w: -w.share))


def bands(
    gaps: Sequence[Gap],
    floor: Mapping[str, float],
    after: Sequence[Gap] = (),
    settings: Locating = DEFAULT.locating,
) -> tuple[Band, ...]:
    """Return the gap by joint and band of frequencies, as far as the rows can tell.

    Args:
        gaps: each log with its replay in the model as given.
        floor: white noise of each joint.
        after: each log with its replay in the corrected model; as before if none.
        settings: the edges of the bands.
    """
    found = []
    for joint in dict.fromkeys(joint for gap in gaps for joint in gap.joints):
        edges = settings.edges_hz
        old, nyquist = _spectrum(gaps, joint, edges)
        new = _spectrum(after, joint, edges)[0] if after else old
        for k, (low, high) in enumerate(pairwise(edges)):
            if low < nyquist:
                part = (min(high, nyquist) - low) / nyquist
                noise = floor.get(joint, 0.0) * float(np.sqrt(part))
                top = min(high, nyquist)
                sizes = (float(np.sqrt(s[k])) for s in (old, new))
                found.append(Band(joint, low, top, *sizes, floor=noise))
    return tuple(found)


def as_gaps(data: Data, error: np.ndarray) -> list[Gap]:
    """Return each log's compared rows with what was simulated, from held-out errors (W, T, M)."""
    found = []
    for number, log in enumerate(data.logs):
        rows, simulated, said = [], [], []
        for index, window in enumerate(data.windows):
            if window.log == number:
                own = np.flatnonzero(window.usable)
                rows.append(window.first + own)
                said.append(window.measured[own])
                simulated.append(said[-1] + error[index, own] * data.scale)
        kept = np.concatenate(rows)
        part = Log({n: v[kept] for n, v in log.columns.items()}, log.meta, log.path)
        names = tuple(joint.name for joint in data.joints)
        both = np.concatenate(said), np.concatenate(simulated)
        found.append(Gap(part, names, part.time, *both))
    return found


def _errors(gaps: Sequence[Gap], joint: str) -> np.ndarray:
    """Simulated minus measured over all logs that have the joint, (T,)."""
    parts = [
        gap.simulated[:, gap.joints.index(joint)] - gap.measured[:, gap.joints.index(joint)]
        for gap in gaps
        if joint in gap.joints
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


def _cells(
    gaps: Sequence[Gap],
    models: Sequence[mujoco.MjModel],
    joint: str,
    errors: np.ndarray,
    rng: np.random.Generator,
    settings: Settings,
) -> Iterator[_Cell]:
    """Yield the kinds of moments of one joint, of whose error they are a part."""
    kinds: dict[tuple[str, str], list[np.ndarray]] = {}
    own = [(gap.log, m) for gap, m in zip(gaps, models, strict=True) if joint in gap.joints]
    if not all(f"qpos.{joint}" in log.columns for log, _ in own):
        return
    blocks, count, sizes = [], 0, [len(log) for log, _ in own]
    for number, (log, model) in enumerate(own):
        for group, name, rows in _kinds(log, model, joint, settings):
            parts = kinds.setdefault((group, name), [np.zeros(n, bool) for n in sizes])
            parts[number] = rows
        fresh = np.diff(log.episode, prepend=log.episode[0]) != 0
        fresh |= np.diff(np.floor(log.time / settings.bootstrap.block_s), prepend=0) != 0
        blocks.append(count + np.cumsum(fresh))
        count = int(blocks[-1][-1]) + 1
    block, square = np.concatenate(blocks), errors**2
    draws = settings.bootstrap.draws
    weights = rng.multinomial(count, np.full(count, 1 / count), draws)  # (D, blocks)
    whole = np.maximum(weights @ np.bincount(block, square, count), TINY_SQUARE)
    for (group, name), parts in kinds.items():
        rows = np.concatenate(parts)
        if rows.any():
            shares = weights @ np.bincount(block[rows], square[rows], count) / whole
            low = float(np.quantile(shares, settings.inference.level))
            share = float(square[rows].sum() / max(square.sum(), TINY_SQUARE))
            yield _Cell(group, name, share, low, float(rows.mean()))


def _kinds(
    log: Log, model: mujoco.MjModel, joint: str, settings: Settings
) -> Iterator[tuple[str, str, np.ndarray]]:
    """The kinds of moments of a log, its episodes and itself among them."""
    yield from regimes(log, model, joint, settings)
    name = log.path.stem if log.path else "the log"
    numbers = np.unique(log.episode)
    for number in numbers:
        label = name if len(numbers) == 1 else f"{name}, episode {number}"
        yield "episode", label, log.episode == number


def _named(cells: Iterable[_Cell], settings: Locating) -> tuple[Regime, ...]:
    """The kinds of moments that hold more than their part, the best of each group."""
    best: dict[str, _Cell] = {}
    for cell in cells:
        more = cell.low > settings.lift * cell.time and cell.share > settings.share_min
        if more and (cell.group not in best or cell.share > best[cell.group].share):
            best[cell.group] = cell
    chosen = sorted(best.values(), key=lambda c: -(c.share - c.time))
    return tuple(Regime(cell.name, cell.share) for cell in chosen[: settings.named_max])


def _spectrum(gaps: Sequence[Gap], joint: str, edges: Sequence[float]) -> tuple[np.ndarray, float]:
    """Mean squared error in each band, (bands,), and the highest frequency that rows show."""
    power, rows, nyquist = np.zeros(len(edges) - 1), 0, np.inf
    for gap in (g for g in gaps if joint in g.joints):
        column = gap.joints.index(joint)
        error = gap.simulated[:, column] - gap.measured[:, column]
        for number in np.unique(gap.log.episode):
            own = gap.log.episode == number
            time, values = gap.time[own], error[own]
            dt = float(np.median(np.diff(time)))
            clock = np.arange(time[0], time[-1] + dt / 2, dt)
            evenly = np.interp(clock, time, values)
            rates, line = periodogram(evenly, 1 / dt, detrend=False, scaling="spectrum")  # type: ignore[arg-type]
            bins = np.clip(np.searchsorted(edges, rates, side="right") - 1, 0, len(power) - 1)
            power += len(clock) * np.bincount(bins, line, len(power))
            rows, nyquist = rows + len(clock), min(nyquist, 1 / (2 * dt))
    return power / max(rows, 1), min(nyquist, edges[-1])
