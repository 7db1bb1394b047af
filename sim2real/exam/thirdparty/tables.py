"""Tables and the picture of the exam on other engines.

Shares have Wilson's 95 % intervals, medians the bootstrap's.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim2real.exam.score import EDGES, confidences, mean, median, of, wilson
from sim2real.exam.thirdparty.kinds import KINDS
from sim2real.exam.thirdparty.marks import Mark
from sim2real.runs.figures import INK, figure
from sim2real.runs.tables import Table


def lines(marks: Sequence[Mark]) -> Table:
    """Return the figures that the exam aims at, each with its cases and interval."""
    table = Table(("figure", "cases", "value", "aim"))

    def add(label: str, kind: str, name: str, aim: str) -> None:
        values = of([one for one in marks if one.kind == kind], name)
        table.add(label, len(values), wilson(values), aim)

    add("single: rank 1 right", "single", "rank1", "≥ 0.85")
    add("single: explained", "single", "explained", "≥ 0.75")
    add("two: either at rank 1", "two", "rank1", "")
    add("two: both among three", "two", "rank3", "")
    add("dirty background: dominant cause at rank 1", "dirty", "rank1", "≥ 0.85")
    add("dirty background: place right", "dirty", "place", "≥ 0.90")
    add("outside laws: called explained", "outside", "explained", "≤ 0.10")
    add("outside laws: joint right", "outside", "place", "≥ 0.85")
    add("off-nominal: a single cause, confidence ≥ 0.8", "off_nominal", "sure", "≤ 0.05")
    add("robot-wide: named as robot-wide", "robot_wide", "rank1", "≥ 0.90")
    add("torque-controlled: rank 1 right", "torque", "rank1", "≥ 0.80")
    add("two encoders: rank 1 right", "encoders", "rank1", "")
    wrong = [not one.rank1 for one in marks if one.verdict == "explained"]
    table.add("of all called explained: a false first cause", len(wrong), wilson(wrong), "")
    covered = of(marks, "covered")
    table.add("value in its 90 % interval", len(covered), wilson(covered), "0.82 to 0.96")
    said, _ = confidences(marks)
    table.add("calibration error of the confidence", len(said), calibration_error(marks), "≤ 0.07")
    return table


def by_kind(marks: Sequence[Mark], rng: np.random.Generator) -> Table:
    """Return every mark kind by kind."""
    names = ("rank1", "rank3", "place", "explained", "sure", "covered")
    middles = ("closed", "error", "seconds")
    table = Table(("kind", "cases", *names, "superfluous", *middles))
    for kind in (*KINDS, "all"):
        own = [one for one in marks if kind in (one.kind, "all")]
        if own:
            shares = [wilson(of(own, name)) for name in names]
            extra = of(own, "superfluous")
            medians = [median(of(own, name), rng) for name in middles]
            table.add(kind, len(own), *shares, mean(extra), *medians)
    table.notes.append(
        "`superfluous`: causes a case that nothing hidden stands behind, mean. Medians: `closed`, "
        "share of the closable gap of a log that the diagnosis never saw; `error`, relative, of "
        "the first cause's value; `seconds` of a diagnosis."
    )
    return table


def recall(marks: Sequence[Mark]) -> Table:
    """Return how many of an effect's cases are right, kind by kind: `2 of 3`."""
    kinds, effects, right, asked = _counts(marks)
    table = Table(("effect", *kinds))
    for effect, hits, count in zip(effects, right.tolist(), asked.tolist(), strict=True):
        cells = (f"{h} of {n}" if n else None for h, n in zip(hits, count, strict=True))
        table.add(effect, *cells)
    return table


def draw(marks: Sequence[Mark], path: Path) -> None:
    """Draw the recall of each effect in each kind; the numbers are right of asked."""
    kinds, effects, right, asked = _counts(marks)
    shares = np.where(asked > 0, right / np.maximum(asked, 1), np.nan)
    with figure(path, 1, 1, (2.8 + 0.9 * len(kinds), 1.6 + 0.25 * len(effects))) as (_, axes):
        panel = axes[0, 0]
        panel.imshow(shares, cmap="RdYlBu", vmin=0, vmax=1, aspect="auto")
        for row, column in np.argwhere(asked):
            text = f"{right[row, column]}/{asked[row, column]}"
            panel.text(column, row, text, ha="center", va="center", color=INK, fontsize=7)
        panel.set_yticks(range(len(effects)), [name.replace("_", " ") for name in effects])
        panel.set_xticks(range(len(kinds)), [name.replace("_", " ") for name in kinds], rotation=30)
        panel.spines[:].set_visible(False)
        panel.tick_params(length=0)


def _counts(marks: Sequence[Mark]) -> tuple[list[str], list[str], np.ndarray, np.ndarray]:
    """Return kinds, effects, and how many of their cases are right and were asked, (E, K) each."""
    held = [one for one in marks if one.truths]
    kinds = [kind for kind in KINDS if any(one.kind == kind for one in held)]
    effects = sorted({effect for one in held for effect in one.truths})
    right, asked = np.zeros((2, len(effects), len(kinds)), int)
    for one in held:
        for effect in one.truths:
            place = effects.index(effect), kinds.index(one.kind)
            asked[place] += 1
            right[place] += not one.reason
    return kinds, effects, right, asked


def calibration_error(marks: Sequence[Mark]) -> float | None:
    """Return how far confidences are from the shares that are right; None of no answers."""
    said, right = confidences(marks)
    return expected_error(said, right.astype(float)) if len(said) else None


def expected_error(said: np.ndarray, right: np.ndarray) -> float:
    """Return the mean distance of confidence from the share that is right, over bins of EDGES.

    The expected calibration error of Naeini et al. (2015), "Obtaining well calibrated
    probabilities using Bayesian binning".

    Args:
        said: confidences, (N,).
        right: 1 where right, else 0, (N,).
    """
    bins = np.digitize(said, EDGES)
    gaps = [abs((said - right)[bins == one].sum()) for one in np.unique(bins)]
    return float(np.sum(gaps) / len(said))
