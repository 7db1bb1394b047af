"""The confusion matrix of an exam: what was hidden against what was named first.

A cell counts cases; the diagonal is right.

    counts = confusion(marks)
    table(counts).write(out / "matrix")
    draw(counts, out / "plots" / "matrix.png")
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim2real.exam.hiding import EFFECTS
from sim2real.exam.score import Mark
from sim2real.runs.figures import INK, figure
from sim2real.runs.tables import Table

NOTHING = "nothing"
RIGHT_OF_NOTHING = "no_gap"


class Confusion(NamedTuple):
    """How often each name was given for each hidden effect."""

    hidden: list[str]
    named: list[str]
    counts: np.ndarray  # (hidden, named)


def confusion(marks: Sequence[Mark]) -> Confusion:
    """Count the cases with one hidden effect, and those with none."""
    asked = [one for one in marks if one.kind in ("one", "none")]
    pairs = [(one.truths[0] if one.truths else NOTHING, one.first) for one in asked]
    order = [*EFFECTS, NOTHING]
    hidden = sorted({truth for truth, _ in pairs}, key=order.index)
    right = [RIGHT_OF_NOTHING if name == NOTHING else name for name in hidden]
    others = sorted({first for _, first in pairs} - set(right))
    named = list(dict.fromkeys([*right, *others]))
    counts = np.zeros((len(hidden), len(named)), int)
    for truth, first in pairs:
        counts[hidden.index(truth), named.index(first)] += 1
    return Confusion(hidden, named, counts)


def table(found: Confusion) -> Table:
    """Return the matrix as a table: a row for each hidden effect, empty cells for 0."""
    rows = Table(("hidden", *found.named))
    for name, counts in zip(found.hidden, found.counts.tolist(), strict=True):
        rows.add(name, *(count or None for count in counts))
    rows.notes.append("Columns: what was named first; a set that holds the truth counts as it.")
    return rows


def draw(found: Confusion, path: Path) -> None:
    """Draw the matrix; what is right lies on the diagonal."""
    rows, columns = found.counts.shape
    shares = found.counts / np.maximum(found.counts.sum(axis=1, keepdims=True), 1)
    with figure(path, 1, 1, (2.6 + 0.34 * columns, 2.2 + 0.28 * rows)) as (_, axes):
        panel = axes[0, 0]
        panel.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        for row, column in np.argwhere(found.counts):
            colour = "white" if shares[row, column] > 0.6 else INK
            count = str(found.counts[row, column])
            panel.text(column, row, count, ha="center", va="center", color=colour, fontsize=7)
        panel.set_yticks(range(rows), [name.replace("_", " ") for name in found.hidden])
        words = [name.replace("_", " ") for name in found.named]
        panel.set_xticks(range(columns), words, rotation=90)
        panel.set_xlabel("named first")
        panel.set_ylabel("hidden")
        panel.spines[:].set_visible(False)
        panel.tick_params(length=0)
