"""How earlier observations are stacked in a vector, found from the vector alone.

    stack = unstack(values, about, rows, limits)
    stack.newest                    # (T, frame), to be compared term by term
    stack.faults                    # [] where frames are ordered, laid out and aged as described

A frame of age h must equal the newest frame of h rows before: that needs no channel of the log.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.contract.answer import Finding
from sim2real.diagnosis.contract.description import Description, History
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.settings import Contract

PLACE = "history"


class Stack(NamedTuple):
    """A vector taken apart.

    Attributes:
        newest: the newest frame, (T, F).
        faults: what is wrong with the stacking.
        misfit: what is left of the frames' disagreement, of the spread.
        open: whether the frames are too alike to judge.
    """

    newest: np.ndarray
    faults: list[Finding]
    misfit: float
    open: bool


class Way(NamedTuple):
    """A way to stack, what it is called, and its misfit."""

    fault: str
    text: str
    fix: str
    newest: np.ndarray
    misfit: float


def unstack(values: np.ndarray, about: Description, rows: Rows, limits: Contract) -> Stack:
    """Take vectors (T, H F) apart and find how they were stacked."""
    length = about.history.length
    if length == 1:
        return Stack(values, [], 0.0, False)
    plain = _way(values, about.history, about, rows, limits)
    if plain.misfit <= limits.suspect:
        same = _way(values, about.history, about, rows, limits, 0)  # all frames are the newest
        return Stack(plain.newest, [], plain.misfit, same.misfit <= limits.suspect)
    best = min(_others(values, about, rows, limits), key=lambda way: way.misfit)
    if best.misfit > limits.margin * plain.misfit:
        return Stack(plain.newest, [_unexplained(plain)], plain.misfit, False)
    fault = Finding(
        "observation", best.fault, PLACE, best.text, best.fix, plain.misfit, best.misfit, None
    )
    return Stack(best.newest, [fault], best.misfit, False)


def _others(values: np.ndarray, about: Description, rows: Rows, limits: Contract) -> list[Way]:
    """Return the ways to stack that are not as described."""
    own, found = about.history, []
    for layout, order in product(("frame", "term"), ("oldest_first", "newest_first")):
        if (layout, order) == (own.layout, own.order):
            continue
        what = [f"{layout} after {layout}"] if layout != own.layout else []
        what += [order.replace("_", " ")] if order != own.order else []
        fault = "history_layout" if layout != own.layout else "history_order"
        text = f"the history is stacked {' and '.join(what)}"
        fix = f"stack it {own.order.replace('_', ' ')}, {own.layout} after {own.layout}"
        made = _way(values, History(own.length, layout, order), about, rows, limits)
        found.append(made._replace(fault=fault, text=text, fix=fix))
    for stride in (0, *range(2, limits.ages_max + 1)):
        made = _way(values, own, about, rows, limits, stride)
        same = "all frames of the history are the newest one"
        text = same if stride == 0 else f"the frames of the history are {stride} steps apart"
        fix = "push one frame a control step"
        found.append(made._replace(fault="history_length", text=text, fix=fix))
    return found


def _way(
    values: np.ndarray,
    history: History,
    about: Description,
    rows: Rows,
    limits: Contract,
    stride: int = 1,
) -> Way:
    """Return a way to stack and how far frames then are from the newest one's past."""
    frames = _frames(values, history, [term.size for term in about.terms])  # (T, H, F), newest 0
    newest = frames[:, 0]
    use = rows.deep(history.length * max(stride, 1))
    if len(use) < limits.rows_min:
        return Way("", "", "", newest, 0.0)
    past = np.stack([rows.older(newest, h * stride) for h in range(history.length)], axis=1)
    spread = np.maximum(newest[use].std(axis=0), limits.still)
    error = ((frames - past)[use] / spread)[:, 1:]
    return Way("", "", "", newest, float(np.sqrt(np.mean(error**2))))


def _frames(values: np.ndarray, history: History, sizes: list[int]) -> np.ndarray:
    """Return the frames of vectors, the newest first, (T, H, F)."""
    rows, length = len(values), history.length
    if history.layout == "frame":
        frames = values.reshape(rows, length, -1)
    else:
        cuts = np.cumsum([size * length for size in sizes])[:-1]
        parts = [part.reshape(rows, length, -1) for part in np.split(values, cuts, axis=1)]
        frames = np.concatenate(parts, axis=2)
    return frames if history.order == "newest_first" else frames[:, ::-1]


def _unexplained(plain: Way) -> Finding:
    text = (
        f"the frames of the history disagree with each other by {plain.misfit:.0%} of their "
        "spread, and no order, layout or spacing that is looked for explains it"
    )
    fix = "compare the code that stacks the frames with the training's"
    return Finding("observation", "unexplained", PLACE, text, fix, plain.misfit, plain.misfit)
