"""How earlier observations are stacked in a vector, found from the vector alone.

    newest = unstack(stage, values, about, rows, limits)    # (T, frame)
    stage.findings                  # none where frames are ordered, laid out and aged as described

A frame of age h must equal the newest frame of h rows before: that needs no channel of the log.
"""

from collections.abc import Iterator
from itertools import product
from typing import get_args

import numpy as np

from sim2real.diagnosis.contract.answer import Finding, Stage
from sim2real.diagnosis.contract.description import Description, History, Layout, Order
from sim2real.diagnosis.contract.rebuild import Mistake
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.settings import Contract


def unstack(
    stage: Stage, values: np.ndarray, about: Description, rows: Rows, limits: Contract
) -> np.ndarray:
    """Take vectors (T, H F) apart; return the newest frame (T, F), and add how they are stacked."""
    own = about.history
    plain = frames = _frames(values, own, about)
    if own.length == 1:
        return plain[:, 0]
    before = _misfit(plain, 1, rows, limits)
    if before > limits.suspect:
        ways = [
            (mistake, other, _misfit(other, stride, rows, limits))
            for mistake, history, stride in _others(own, limits)
            for other in [_frames(values, history, about)]
        ]
        mistake, frames, after = min(ways, key=lambda way: way[2])
        if after > limits.margin * before:
            text = (
                f"the frames of the history disagree with each other by {before:.0%} of their "
                "spread, and no order, layout or spacing that is looked for explains it"
            )
            fix = "compare the code that stacks the frames with the training's"
            mistake, frames, after = Mistake("unexplained", text, fix), plain, before
        fault = "observation", mistake.fault, "history", mistake.text, mistake.fix
        stage.findings.append(Finding(*fault, before, after))
    elif _misfit(plain, 0, rows, limits) <= limits.suspect:
        stage.open("history", "the frames are alike: their order is unknown")
    return frames[:, 0]


def _others(own: History, limits: Contract) -> Iterator[tuple[Mistake, History, int]]:
    """Yield the ways to stack that are not as described, and the steps between their frames."""
    for layout, order in product(get_args(Layout), get_args(Order)):
        what = [f"{layout} after {layout}"] if layout != own.layout else []
        what += [order.replace("_", " ")] if order != own.order else []
        fault = "history_layout" if layout != own.layout else "history_order"
        text = f"the history is stacked {' and '.join(what)}"
        fix = f"stack it {own.order.replace('_', ' ')}, {own.layout} after {own.layout}"
        if what:
            yield Mistake(fault, text, fix), History(own.length, layout, order), 1
    for stride in (0, *range(2, limits.ages_max + 1)):
        same = "all frames of the history are the newest one"
        text = same if stride == 0 else f"the frames of the history are {stride} steps apart"
        yield Mistake("history_length", text, "push one frame a control step"), own, stride


def _misfit(frames: np.ndarray, stride: int, rows: Rows, limits: Contract) -> float:
    """Return how far frames (T, H, F), so many steps apart, are from the newest one's past."""
    newest, length = frames[:, 0], frames.shape[1]
    use = rows.deep(length * max(stride, 1))
    if len(use) < limits.rows_min:
        return 0.0
    past = np.stack([rows.older(newest, h * stride) for h in range(length)], axis=1)
    spread = np.maximum(newest[use].std(axis=0), limits.still)
    error = ((frames - past)[use] / spread)[:, 1:]
    return float(np.sqrt(np.mean(error**2)))


def _frames(values: np.ndarray, history: History, about: Description) -> np.ndarray:
    """Return the frames of vectors, the newest first, (T, H, F)."""
    rows, length = len(values), history.length
    if history.layout == "frame":
        frames = values.reshape(rows, length, -1)
    else:
        cuts = np.cumsum([term.size * length for term in about.terms])[:-1]
        parts = [part.reshape(rows, length, -1) for part in np.split(values, cuts, axis=1)]
        frames = np.concatenate(parts, axis=2)
    return frames if history.order == "newest_first" else frames[:, ::-1]
