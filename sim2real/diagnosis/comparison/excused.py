"""What is put down to temperature, mounting and supply, simulated rather than drawn as a line.

    left = excuse(pieces, simulator, watch, response, error, later, columns, contrast)
    left.pieces, left.moved, left.response

A tenth less friction in all joints moves a robot by more than a few per cent of it in one, and its
straight line is wrong by as much as what is looked for. So the side after is simulated once more
with what was put down to other things, and only what that leaves is explained by straight lines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.permuted import RIDGE
from sim2real.diagnosis.comparison.pieces import Pieces
from sim2real.diagnosis.comparison.response import Response, Watch, errors
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import TINY_SQUARE


class Excused(NamedTuple):
    """What is left, and what was simulated."""

    pieces: Pieces
    moved: dict[int, float]  # of each column
    response: float  # RMS of what that makes, in units of the noise


def excuse(
    first: Pieces,
    simulator: Simulator,
    watch: Watch,
    response: Response,
    error: np.ndarray,
    later: np.ndarray,
    columns: Sequence[int],
    ends: np.ndarray,
    contrast: Callable[[np.ndarray], Pieces],
) -> Excused:
    """Return what is left once the side after is simulated with what is put down to other things.

    Args:
        first: the pieces of the errors as they are.
        simulator: of all windows.
        watch: what both sides have.
        response: the columns.
        error: of all windows with what both sides have, (W, T, M).
        later: the windows of the side after, (n,).
        columns: those that something else may have changed, n of them.
        ends: the least and the largest change of each, (2, n).
        contrast: makes pieces of errors (W, T, M).
    """
    best, moved = first, dict.fromkeys(columns, 0.0)
    if not columns:
        return Excused(best, moved, 0.0)
    options = [response.columns[k] for k in columns]
    typical = [float(one.option.step[one.place]) for one in options]
    for _ in range(simulator.data.settings.compared.excused_rounds):
        sizes = np.array([*typical, *[np.inf] * len(best.clocks)])
        more = _fitted(best, [*columns, *best.clocks], sizes)[: len(columns)]
        whole = np.clip(np.array(list(moved.values())) + more, *ends)
        tried = dict(zip(columns, whole.tolist(), strict=True))
        shifted = error.copy()
        shifted[later] = errors(simulator, _with(watch, response, tried), later)
        pieces = contrast(shifted)
        if _left(pieces, simulator) >= _left(best, simulator):
            break
        best, moved = pieces, tried
    use, change = np.array(columns), np.array(list(moved.values()))
    curve = best.curve[:, use[:, None], use].sum(axis=0)
    return Excused(best, moved, float(np.sqrt(max(change @ curve @ change, 0.0) / best.rows)))


def _fitted(pieces: Pieces, columns: Sequence[int], typical: np.ndarray) -> np.ndarray:
    """Return the changes of columns that explain the pieces best, all together, (n,).

    A change has a prior of its typical size (n,): what the motion does not show stays as it was.
    """
    use = np.array(columns)
    curve, down = pieces.curve[:, use[:, None], use], pieces.down[:, use]
    prior = np.diag(typical**-2.0)
    if pieces.after is None:
        return np.linalg.solve(curve.sum(axis=0) + prior, down.sum(axis=0))
    own, whole = curve[pieces.after].sum(axis=0), curve.sum(axis=0)
    tiny = RIDGE * np.diag(np.diag(whole)) + TINY_SQUARE * np.eye(len(use))
    matrix = np.block([[whole + tiny, own], [own, own + prior + tiny]])  # of both, of the change
    right = np.concatenate([down.sum(axis=0), down[pieces.after].sum(axis=0)])
    return np.linalg.solve(matrix, right)[len(use) :]


def _with(watch: Watch, response: Response, changes: dict[int, float]) -> Watch:
    """Return the watch with columns changed."""
    for k, change in changes.items():
        for part, share in response.parts.get(k, ((k, 1.0),)):
            watch = watch.moved(response.columns[part], share * change)
    return watch


def _left(pieces: Pieces, simulator: Simulator) -> float:
    return float(np.sum((pieces.before_rms / simulator.data.scale) ** 2))
