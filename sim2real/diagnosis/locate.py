"""Where the gap lies: which joint, and at which kind of moment.

    table = locate(gaps, noise_floor(logs), models, rng=np.random.default_rng(0))
    table.where                     # for the report: joints, the largest share first
    table.cells                     # every kind of moment of every joint, for pictures
    bands(gaps, floor)              # the same by frequency

A share is a part of a joint's squared error. A kind of moment is named where its share is larger
than its part of the time, by more than a block bootstrap leaves to chance.
"""

from collections.abc import Iterator, Mapping, Sequence
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


class Cell(NamedTuple):
    """One joint at one kind of moment."""

    joint: str
    group: str  # such as "speed"
    name: str  # such as "fast"
    share: float  # of the joint's squared error
    low: float  # of its 90 % interval
    high: float
    time: float  # share of the rows
    before: float  # RMS error there
    after: float | None


class Table(NamedTuple):
    """The gap by joint, and by joint and kind of moment."""

    where: tuple[JointGap, ...]
    cells: tuple[Cell, ...]


def locate(
    gaps: Sequence[Gap],
    floor: Mapping[str, float],
    models: Sequence[mujoco.MjModel] = (),
    after: Sequence[Gap] = (),
    *,
    rng: np.random.Generator,
    scale: Mapping[str, float] | None = None,
    settings: Settings = DEFAULT,
) -> Table:
    """Share the gap out.

    Args:
        gaps: each log with its replay in the model as given.
        floor: noise of each joint; what is left of its squared error above it counts.
        models: the model of each log, for loads and actuators; none leaves these out.
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
    cells: list[Cell] = []
    for joint in joints:
        later = new.get(joint)
        cells += _cells(gaps, models, joint, old[joint], later, rng, settings)
    where = [
        JointGap(
            joint,
            power[joint] / total if total > 0 else 0.0,
            _rms(old[joint]),
            _rms(new[joint]) if joint in new else None,
            _named([cell for cell in cells if cell.joint == joint], settings.locating),
        )
        for joint in joints
    ]
    return Table(tuple(sorted(where, key=lambda w: -w.share)), tuple(cells))


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
    old: np.ndarray,
    new: np.ndarray | None,
    rng: np.random.Generator,
    settings: Settings,
) -> Iterator[Cell]:
    """The kinds of moments of one joint."""
    kinds: dict[tuple[str, str], list[np.ndarray]] = {}
    pairs = zip(gaps, models if len(models) else [None] * len(gaps), strict=True)
    own = [(gap, model) for gap, model in pairs if joint in gap.joints]
    blocks, count, sizes = [], 0, [len(gap.time) for gap, _ in own]
    if not all(f"qpos.{joint}" in gap.log.columns for gap, _ in own):
        return
    for number, (gap, model) in enumerate(own):
        log = gap.log
        for kind in _kinds(log, model, joint, settings):
            rows = kinds.setdefault((kind[0], kind[1]), [np.zeros(n, bool) for n in sizes])
            rows[number] = kind[2]
        new_block = np.diff(log.episode, prepend=log.episode[0]) != 0
        new_block |= np.diff(np.floor(log.time / settings.dataset.block_s), prepend=0) != 0
        blocks.append(count + np.cumsum(new_block))
        count = int(blocks[-1][-1]) + 1
    block = np.concatenate(blocks)
    power = np.bincount(block, old**2, count)
    weights = rng.multinomial(
        count, np.full(count, 1 / count), settings.bootstrap.draws
    )  # (D, blocks)
    level = settings.inference.level
    whole = np.maximum(weights @ power, TINY_SQUARE)
    for (group, name), parts in kinds.items():
        rows = np.concatenate(parts)
        if not rows.any():
            continue
        shares = weights @ np.bincount(block[rows], old[rows] ** 2, count) / whole
        low, high = np.quantile(shares, [level, 1 - level])
        share = float(np.sum(old[rows] ** 2) / max(np.sum(old**2), TINY_SQUARE))
        later = None if new is None or len(new) != len(old) else _rms(new[rows])
        time = float(rows.mean())
        yield Cell(joint, group, name, share, float(low), float(high), time, _rms(old[rows]), later)


def _kinds(
    log: Log, model: mujoco.MjModel | None, joint: str, settings: Settings
) -> Iterator[tuple[str, str, np.ndarray]]:
    """The kinds of moments of a log, its episodes and itself among them."""
    yield from regimes(log, model, joint, settings)
    name = log.path.stem if log.path else "the log"
    numbers = np.unique(log.episode)
    for number in numbers:
        label = name if len(numbers) == 1 else f"{name}, episode {number}"
        yield "episode", label, log.episode == number


def _named(cells: Sequence[Cell], settings: Locating) -> tuple[Regime, ...]:
    """The kinds of moments that hold more than their part, the best of each group."""
    best: dict[str, Cell] = {}
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
