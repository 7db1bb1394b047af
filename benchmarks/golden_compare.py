"""How two records of the golden files differ.

    rows = compared(before["jobs"], after["jobs"])
    print(markdown(rows, every=False))
    judged("alike", ["training_return"], before["jobs"], after["jobs"], rows).passed

Figures are compared leaf by leaf and bit by bit; where two numbers differ, the table says by how
much, relative to the larger one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

TOLERANCE = 0.15  # of a mean return, that new trainings may differ from the old ones
CONFIDENCE = 0.9  # of the interval that must lie inside: a test of equivalence at 5 %
SHOWN = 48  # characters of a value in the table
Jobs = Mapping[str, Mapping[str, Any]]


class Difference(NamedTuple):
    """A figure that is not the same.

    Args:
        path: where it stands, with dots between.
        old: its value before; MISSING where there was none.
        new: its value now; MISSING where there is none.
        share: difference relative to the larger number; infinite where they are no numbers.
    """

    path: str
    old: Any
    new: Any
    share: float


class Row(NamedTuple):
    """How a job compares: how many figures it has, and those that differ."""

    job: str
    figures: int
    differences: list[Difference]


class Verdict(NamedTuple):
    """Whether a part is as it must be, and what there is to say."""

    passed: bool
    sentence: str


MISSING = "(missing)"


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the value of every leaf of nested dicts and lists."""
    if isinstance(value, Mapping) and value:
        for name, inner in value.items():
            yield from leaves(inner, f"{path}.{name}" if path else str(name))
    elif isinstance(value, list) and value:
        for i, inner in enumerate(value):
            yield from leaves(inner, f"{path}[{i}]")
    else:
        yield path, value


def relative(old: Any, new: Any) -> float:
    """Return the relative difference of two values that are not equal."""
    numbers = [v for v in (old, new) if isinstance(v, int | float) and not isinstance(v, bool)]
    if len(numbers) < 2 or not np.isfinite(numbers).all():
        return float("inf")
    return abs(old - new) / max(abs(old), abs(new))


def same(old: Any, new: Any) -> bool:
    """Return whether two leaves are the same: value and type, NaN being NaN."""
    return type(old) is type(new) and (old == new or (old != old and new != new))


def compared(before: Jobs, after: Jobs) -> list[Row]:
    """Compare the figures of all jobs of two records of one part."""
    return [_row(name, before.get(name, {}), after.get(name, {})) for name in {**before, **after}]


def _row(name: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> Row:
    old, new = (dict(leaves(job.get("figures", {}))) for job in (before, after))
    paths = {**old, **new}
    pairs = [(path, old.get(path, MISSING), new.get(path, MISSING)) for path in paths]
    found = [Difference(p, a, b, relative(a, b)) for p, a, b in pairs if not same(a, b)]
    return Row(name, len(paths), found)


def markdown(rows: Sequence[Row], every: bool) -> str:
    """Return the table: a line a job, with its largest difference, or one for each difference."""
    lines = ["| job | figures | differ | largest, or each | before | now | by |", "|---" * 7 + "|"]
    for row in rows:
        lines += [_line(row, d) for d in _chosen(row, every)]
        if not row.differences:
            lines.append(f"| {row.job} | {row.figures} | identical | | | | |")
    return "\n".join(lines) + "\n"


def _chosen(row: Row, every: bool) -> list[Difference]:
    """Return all differences, or the largest one between numbers, or else the first."""
    if every or len(row.differences) < 2:
        return row.differences
    numbers = [d for d in row.differences if np.isfinite(d.share)]
    return [max(numbers, key=lambda d: d.share) if numbers else row.differences[0]]


def _line(row: Row, found: Difference) -> str:
    share = f"{found.share:.2g}" if np.isfinite(found.share) else "–"
    old, new = (str(v)[:SHOWN].replace("|", "/") for v in (found.old, found.new))
    count = len(row.differences)
    return f"| {row.job} | {row.figures} | {count} | {found.path} | {old} | {new} | {share} |"


def judged(
    rule: str, figures: Sequence[str], before: Jobs, after: Jobs, rows: Sequence[Row]
) -> Verdict:
    """Say whether a part is as its rule asks.

    Args:
        rule: "identical", "alike" or "printed".
        figures: whose means over the jobs are told; "alike" asks it of the first.
        before: the jobs of the old record.
        after: those of the new one.
        rows: how they compare.
    """
    differ = sum(bool(row.differences) for row in rows)
    if not differ:
        return Verdict(True, f"**identical**: {len(rows)} of {len(rows)} jobs.")
    if rule == "identical":
        return Verdict(False, f"**differs**: {differ} of {len(rows)} jobs.")
    if min(len(before), len(after)) < 2:
        return Verdict(False, "**cannot be judged**: means of fewer than two jobs.")
    pairs = {name: (_values(before, name), _values(after, name)) for name in figures}
    told = "\n".join(f"* {name}: {means(*pair)}" for name, pair in pairs.items())
    if rule == "printed":
        return Verdict(True, told)
    low, high = ratio(*pairs[figures[0]])
    inside = max(1 - low, high - 1) <= TOLERANCE
    word = "alike" if inside else "not shown to be alike"
    return Verdict(inside, f"**{word}** within {TOLERANCE:.0%} in {figures[0]}:\n\n{told}")


def means(old: np.ndarray, new: np.ndarray) -> str:
    """Return the means of two groups, (n,) and (m,), and their ratio, in words."""
    groups = zip((old, new), ("before", "now"), strict=True)
    said = [f"{v.mean():.4g} (sd {v.std(ddof=1):.3g}, n {len(v)}) {when}" for v, when in groups]
    low, high = ratio(old, new)
    share = f"ratio {new.mean() / old.mean():.3f} [{low:.3f}, {high:.3f}]"
    return f"{', '.join(said)}; {share}, {CONFIDENCE:.0%} interval"


def _values(jobs: Jobs, figure: str) -> np.ndarray:
    return np.array([job["figures"][figure] for job in jobs.values()], np.float64)


def ratio(old: np.ndarray, new: np.ndarray) -> tuple[float, float]:
    """Return the interval of the ratio of two means, (n,) and (m,).

    Welch's interval of their difference, over the old mean as if that were known.
    """
    found = stats.ttest_ind(new, old, equal_var=False)
    interval = found.confidence_interval(CONFIDENCE)
    scale = abs(old.mean())
    return 1 + float(interval.low) / scale, 1 + float(interval.high) / scale
