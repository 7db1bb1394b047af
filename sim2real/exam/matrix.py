"""The confusion matrix of an exam: what was hidden against what was named first.

A cell counts cases; the diagonal is right.

    counts = confusion(marks)
    table(counts).write(out / "matrix")
    draw(counts, out / "plots" / "matrix.png")
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sim2real.exam.hiding import EFFECTS
from sim2real.exam.score import Mark
from sim2real.runs.figures import AFTER, BEFORE, figure
from sim2real.runs.tables import Table

NOTHING = "nothing"
RIGHT_OF_NOTHING = "no_gap"


class Confusion(NamedTuple):
    """The confusion matrix: counts of each given name for each hidden effect."""

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
    """Draw how many cases of each hidden effect were named right, and what the others were called.

    The whole matrix is in `table`: nearly all of its cells are empty.
    """
    rows = len(found.hidden)
    own = [RIGHT_OF_NOTHING if name == NOTHING else name for name in found.hidden]
    right = np.array([found.counts[i, found.named.index(name)] for i, name in enumerate(own)])
    wrong = found.counts.sum(axis=1) - right
    with figure(path, 1, 1, (6.4, 0.9 + 0.22 * rows)) as (_, axes):
        panel = axes[0, 0]
        panel.barh(range(rows), right, color=AFTER, label="named first")
        panel.barh(range(rows), wrong, left=right, color=BEFORE, label="another was")
        for row, name in enumerate(own):
            others = [n for k, n in enumerate(found.named) if found.counts[row, k] and n != name]
            words = ", ".join(other.replace("_", " ") for other in others)
            panel.text(right[row] + wrong[row], row, f"  {words}", va="center", fontsize=7)
        panel.set_yticks(range(rows), [name.replace("_", " ") for name in found.hidden])
        panel.invert_yaxis()
        panel.set_xlabel("cases")
        panel.set_ylabel("hidden")
        panel.margins(y=0.02)
        panel.set_xlim(right=1.25 * max(1, int((right + wrong).max())))
        panel.xaxis.get_major_locator().set_params(integer=True)
        panel.legend(loc="upper right")
