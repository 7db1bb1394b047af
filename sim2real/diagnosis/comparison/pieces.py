"""Independent pieces of two sets of logs, and their weighted normal equations.

    pieces = contrasts(made, made.error, before={0, 1}, after={2, 3})
    pieces.curve, pieces.down                   # (B, K, K), (B, K)

Where logs before and after are of the same motions, a piece is a stretch of their difference:
what both have in common cancels, and under the null hypothesis each piece's sign is as likely as
the other one. Elsewhere a piece is a stretch of one log's error, and under the null hypothesis
sides can be exchanged. With enough logs, a piece is a whole log or pair of logs.
"""

from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.motions import Motions
from sim2real.diagnosis.comparison.prepared import Prepared
from sim2real.diagnosis.comparison.response import Response
from sim2real.diagnosis.data.score import coherence
from sim2real.diagnosis.settings import TINY, TINY_SQUARE


class Pieces(NamedTuple):
    """B pieces, and K columns: those of the response, then the clock of each joint.

    Attributes:
        curve: X'X of each, weighted by its noise, (B, K, K).
        down: X'y of each, (B, K), where y is what a change of the columns must make up for.
        after: the side of each, (B,) bool; None for differences of two sides.
        rows: compared numbers, all pieces.
        logs: whether the pieces are whole logs.
        before_rms: of what is compared, by joint [rad or m], (M,).
    """

    curve: np.ndarray
    down: np.ndarray
    after: np.ndarray | None
    rows: int
    logs: bool
    before_rms: np.ndarray

    @property
    def clocks(self) -> tuple[int, ...]:
        """The columns of the joints' clocks."""
        count = self.curve.shape[1]
        return tuple(range(count - len(self.before_rms), count))


class _Stretch(NamedTuple):
    """One window's numbers: what is off, and its columns."""

    wrong: np.ndarray  # (T, M)
    columns: np.ndarray  # (K, T, M)
    mask: np.ndarray  # (T,)
    group: tuple[int, ...]  # the pair or log that it is of
    part: np.ndarray  # (T,) block of each row
    after: bool


Pair = tuple[tuple[int, ...], tuple[int, ...]]


def pairs_of(motions: Motions, before: Collection[int], after: Collection[int]) -> list[Pair]:
    """Return logs of both sides that are of one motion; none if a log after has no partner.

    Each log is in one pair: where one side has more logs of a motion than the other one, several
    of them stand together, and their mean counts.
    """
    found: list[Pair] = []
    for group in motions:
        sides = [[k for k in group if k in side] for side in (before, after)]
        if sides[1] and not sides[0]:
            return []
        count = min(map(len, sides))
        shares = [[tuple(side[i::count]) for i in range(count)] for side in sides]
        found += list(zip(*shares, strict=True))
    return found


def contrasts(
    made: Prepared, error: np.ndarray, before: Collection[int], after: Collection[int]
) -> Pieces:
    """Return the pieces of two sides.

    Args:
        made: the replayed logs, with aligned windows.
        error: of all windows, (W, T, M).
        before: the logs of the first side.
        after: those of the second.
    """
    pairs = pairs_of(made.motions, before, after)
    parts = made.data.blocks(coherence(made.data, error))
    if pairs:
        stretches = list(_differences(made, error, parts, pairs))
    else:
        stretches = list(_errors(made, error, parts, before, after))
    limits = made.data.settings.compared
    groups = {side: {s.group for s in stretches if s.after == side} for side in (False, True)}
    sizes = [len(g) for g in groups.values() if g]
    logs = min(sizes) >= limits.logs_min
    return _summed(stretches, logs, bool(pairs), limits.weight_floor, made.data.scale)


def _differences(
    made: Prepared, error: np.ndarray, parts: np.ndarray, pairs: list[Pair]
) -> Iterator[_Stretch]:
    """Yield the differences of the errors of the second and the first logs of each pair."""
    of = {(made.data.windows[i].log, int(b)): i for i, b in enumerate(made.partner)}
    for first, second in pairs:
        for place, own in enumerate(made.windows.tolist()):
            if all((k, own) in of for k in (*first, *second)):
                ones, others = ([of[k, own] for k in side] for side in (first, second))
                wrong = error[others].mean(axis=0) - error[ones].mean(axis=0)
                mask = np.all(made.data.mask[[*ones, *others]], axis=0)
                columns = _columns(made.response, place)
                yield _Stretch(wrong, columns, mask, (*first, *second), parts[own], False)


def _errors(
    made: Prepared,
    error: np.ndarray,
    parts: np.ndarray,
    before: Collection[int],
    after: Collection[int],
) -> Iterator[_Stretch]:
    """Yield the errors of both sides."""
    place = {int(window): k for k, window in enumerate(made.windows)}
    for i, window in enumerate(made.data.windows):
        own = int(made.partner[i])
        if window.log in {*before, *after} and own in place:
            columns, later = _columns(made.response, place[own]), window.log in after
            mask = made.data.mask[i]
            yield _Stretch(error[i], columns, mask, (window.log,), parts[i], later)


def _columns(response: Response, window: int) -> np.ndarray:
    """Return the columns of a window, then a clock for each joint, (K, T, M).

    Each servo measures and obeys at ticks of its own. Where a tick lies between two messages of
    the bus may differ from one session to the next by up to a tick, at each joint for itself.
    """
    slope = response.slope[window]
    clocks = np.eye(slope.shape[1])[:, None, :] * slope
    return np.concatenate([response.change[:, window], clocks])


def _summed(
    stretches: list[_Stretch], logs: bool, paired: bool, floor: float, scale: np.ndarray
) -> Pieces:
    """Return the sums over each piece, each weighted by its own noise.

    The noise of a piece is that of what is off in it, never less than `floor` of the median: a
    joint that sticks for a while, or an arm that swings freely, must not drown the rest.
    """
    numbers: dict[tuple[int, ...], int] = {}
    rows: list[np.ndarray] = []
    for one in stretches:
        keys = [one.group if logs else (*one.group, int(p)) for p in one.part]
        rows.append(np.array([numbers.setdefault(key, len(numbers)) for key in keys]))
    count, joints = len(numbers), len(scale)
    square, size = np.zeros((count, joints)), np.zeros(count)
    for one, row in zip(stretches, rows, strict=True):
        used = one.mask & (one.part >= 0)
        np.add.at(square, row[used], one.wrong[used] ** 2)
        np.add.at(size, row[used], 1)
    kept = size > 0
    noise = np.sqrt(square / np.maximum(size, 1)[:, None])
    noise = np.maximum(noise, floor * np.median(noise[kept], axis=0))
    weight = 1 / np.maximum(noise, TINY)
    width = stretches[0].columns.shape[0]
    curve, down = np.zeros((count, width, width)), np.zeros((count, width))
    after = np.zeros(count, bool)
    for one, row in zip(stretches, rows, strict=True):
        used = one.mask & (one.part >= 0)
        for piece in np.unique(row[used]):
            mine = used & (row == piece)
            x = (one.columns[:, mine] * weight[piece]).reshape(width, -1)
            y = (one.wrong[mine] * weight[piece]).reshape(-1)
            curve[piece] += x @ x.T
            down[piece] -= x @ y
            after[piece] = one.after
    total = max(float(size.sum()), TINY_SQUARE)
    rms = np.sqrt(square.sum(axis=0) / total) * scale
    sides = None if paired else after[kept]
    return Pieces(curve[kept], down[kept], sides, int(total) * joints, logs, rms)
