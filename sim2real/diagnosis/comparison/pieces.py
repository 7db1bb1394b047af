"""Independent pieces of two sets of logs, and their weighted normal equations.

    pieces = contrasts(made, made.error, before={0, 1}, after={2, 3})
    pieces.curve, pieces.down                   # (B, K, K), (B, K)

Where logs before and after are of the same motions, a piece is a stretch of their difference:
what both have in common cancels, and under the null hypothesis each piece's sign is as likely as
the other one. Elsewhere a piece is a stretch of one log's error, and under the null hypothesis
sides can be exchanged. With enough logs, a piece is a whole log or pair of logs.
"""

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.prepared import Motions, Prepared
from sim2real.diagnosis.data.score import coherence
from sim2real.diagnosis.settings import TINY


class Pieces(NamedTuple):
    """B pieces, and K columns: those of the response, then the clock of each joint."""

    curve: np.ndarray  # (B, K, K) X'X of each, weighted by its noise
    down: np.ndarray  # (B, K) X'y of each, where y is what a change must make up for
    after: np.ndarray | None  # (B,) bool: the side of each; None for differences of two sides
    rows: int  # compared numbers, all pieces
    logs: bool  # whether the pieces are whole logs
    rms: np.ndarray  # (M,) of what is compared, by joint, in the unit of errors

    @property
    def clocks(self) -> tuple[int, ...]:
        """The columns of the joints' clocks."""
        count = self.curve.shape[1]
        return tuple(range(count - len(self.rms), count))


class _Stretch(NamedTuple):
    """The rows of one window that are in one block."""

    lines: np.ndarray  # (K + 1, t, M): the columns, then what is off
    logs: tuple[int, ...]  # the pair or log that it is of
    block: int
    after: bool


Pair = tuple[tuple[int, ...], tuple[int, ...]]  # logs before and after


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
    """Return the pieces of two sides, sets of logs, from the errors of all windows, (W, T, M).

    Each is weighted by the noise of what is off in it, and none by more than half of them are: a
    joint that sticks for a while, or an arm that swings freely, must not drown the rest.
    """
    pairs = pairs_of(made.motions, before, after)
    alone = [((), (k,)) for group in made.motions for k in group if k in {*before, *after}]
    stretches = list(_stretches(made, error, pairs or alone, after))
    sides = [{one.logs for one in stretches if one.after == side} for side in (False, True)]
    logs = min(len(side) for side in sides if side) >= made.data.settings.compared.logs_min
    pieces: dict[tuple[int, ...], list[_Stretch]] = {}
    for one in stretches:
        pieces.setdefault(one.logs if logs else (*one.logs, one.block), []).append(one)
    lines = [np.concatenate([one.lines for one in some], axis=1) for some in pieces.values()]
    noise = np.array([np.sqrt(np.mean(part[-1] ** 2, axis=0)) for part in lines])  # (B, M)
    weight = 1 / np.maximum(np.maximum(noise, np.median(noise, axis=0)), TINY)
    x = [(part * w).reshape(len(part), -1) for part, w in zip(lines, weight, strict=True)]
    square = np.array([own @ own.T for own in x])  # (B, K + 1, K + 1)
    every = np.concatenate([part[-1] for part in lines])
    return Pieces(
        square[:, :-1, :-1],
        -square[:, :-1, -1],
        None if pairs else np.array([some[0].after for some in pieces.values()]),
        every.size,
        logs,
        np.sqrt(np.mean(every**2, axis=0)),
    )


def _stretches(
    made: Prepared, error: np.ndarray, pairs: Sequence[Pair], after: Collection[int]
) -> Iterator[_Stretch]:
    """Yield the errors of the second logs of each pair, less those of the first ones if any."""
    blocks = made.data.blocks(coherence(made.data, error))
    of = {(made.data.windows[i].log, int(b)): i for i, b in enumerate(made.partner)}
    for first, second in pairs:
        for place, own in enumerate(made.windows.tolist()):
            if not all((k, own) in of for k in (*first, *second)):
                continue
            ones, others = ([of[k, own] for k in side] for side in (first, second))
            wrong = error[others].mean(axis=0) - (error[ones].mean(axis=0) if first else 0.0)
            lines = np.concatenate([made.lines[:, place], wrong[None]])
            row = blocks[own if first else others[0]]
            used = np.all(made.data.mask[[*ones, *others]], axis=0) & (row >= 0)
            for block in np.unique(row[used]).tolist():
                mine = used & (row == block)
                later = not first and second[0] in after
                yield _Stretch(lines[:, mine], (*first, *second), block, later)
