"""The output of an identification: the distribution, a table, a picture, numbers.

write(outcome, Path("outputs/identify/..."))    # distribution.yaml, table.md, identify.json, ...
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from envs import distribution_file
from envs.distribution import Distribution
from envs.distribution_file import NINETY
from sim2real.identification.held_out import HeldOutScores
from sim2real.identification.settings import DEFAULT
from sim2real.runs.figures import COLOURS, FAINT, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Cell, Table

FILE = "distribution.yaml"
WIDE, HIGH = 6.4, 0.55  # inches: of the picture, and of a parameter in it
UNIFORM, NORMAL, MEAN = -0.22, 0.0, 0.22  # where in a parameter's line prior, draws and mean are


class Outcome(NamedTuple):
    """A distribution and where it comes from."""

    prior: Distribution
    found: Distribution
    judged: HeldOutScores | None  # None where nothing aligned could be held out
    neutral: np.ndarray  # (P,) values at which the effects are absent
    truth: Mapping[str, float] = {}  # by parameter, of a robot that is known


def table(outcome: Outcome) -> Table:
    """Return a line a parameter: prior, mean with its 90 % interval, spread, and the truth."""
    found, prior = outcome.found, outcome.prior
    known = bool(outcome.truth)
    columns = ["parameter", "unit", "prior low", "prior high", "mean", "std", "spread"]
    made = Table([*columns, "truth"] if known else columns)
    units = [entry.effect.unit for entry in found.entries for _ in entry.laws]
    spread, sure = found.columns("spread"), found.columns("uncertainty")
    for i, (name, law) in enumerate(zip(found.names, found.laws, strict=True)):
        width = NINETY * sure[i]
        mean = Interval(law.mean, max(law.mean - width, law.low), min(law.mean + width, law.high))
        cells: list[Cell] = [
            name,
            units[i],
            prior.laws[i].low,
            prior.laws[i].high,
            law.mean if np.isnan(width) else mean,
            law.std,
            None if np.isnan(spread[i]) else float(spread[i]),
        ]
        made.add(*cells, *([outcome.truth.get(name)] if known else []))
    made.notes.append(
        "mean: with the 90 % interval of the estimate. spread: standard deviation between "
        "episodes (–: one episode cannot tell). std: of a draw, both together, and wider where few "
        "episodes tell the spread."
    )
    made.notes += list(notes(outcome))
    return made


def format_cells(made: Table) -> Table:
    """Return a table whose numbers are texts of three digits, small ones too."""
    rows: list[Sequence[Cell]] = [[_digits(cell) for cell in row] for row in made.rows]
    return Table(made.columns, rows, made.notes)


def _digits(cell: Cell) -> Cell:
    if isinstance(cell, Interval):
        return f"{cell.value:.3g} [{cell.low:.3g}, {cell.high:.3g}]"
    return f"{cell:.3g}" if isinstance(cell, float) else cell


def notes(outcome: Outcome) -> Iterator[str]:
    """Yield what else a person should know, a sentence each."""
    for flat in outcome.found.flat:
        names = " with ".join(f"{name} ({weight:+.2f})" for name, weight in flat.parameters.items())
        yield f"flat: the logs say nothing along {names}; draws keep the prior's width there."
    if "calibration" in outcome.found.made_by:
        yield f"calibration: {outcome.found.made_by['calibration']}."
    judged = outcome.judged
    if judged is not None:
        yield (
            f"held out: gap {judged.before:.4g} before, {judged.after:.4g} after; "
            f"{judged.coverage:.0%} of the readings are within the {judged.band:.0%} band of "
            f"draws; CRPS {judged.crps:.4g}, absolute error {judged.absolute:.4g}."
        )


def warnings(outcome: Outcome) -> Iterator[str]:
    """Yield a sentence for each mean at an end of its prior."""
    found = outcome.found
    for name, law, prior, neutral in zip(
        found.names, found.laws, outcome.prior.laws, outcome.neutral, strict=True
    ):
        near = DEFAULT.border * (prior.high - prior.low)
        for end, word in ((prior.low, "lower"), (prior.high, "upper")):
            if abs(law.mean - end) > near:
                continue
            place = f"{name} = {law.mean:.4g} is at the {word} end of its prior, {end:.4g}"
            if abs(neutral - end) <= near:
                yield f"{place}, where the effect is absent: leave it out of the candidates"
            else:
                yield f"{place}: the truth may lie beyond; widen the prior"


def write(outcome: Outcome, out: Path) -> None:
    """Write distribution.yaml, table.md, table.csv, identify.json and plots/parameters.png."""
    out.mkdir(parents=True, exist_ok=True)
    distribution_file.write(out / FILE, outcome.found)
    made = table(outcome)
    write_text(out / "table.csv", made.csv())
    write_text(out / "table.md", f"# The robot's parameters\n\n{format_cells(made).markdown()}")
    draw(outcome, out / "plots" / "parameters.png")
    judged = None if outcome.judged is None else outcome.judged._asdict()
    content = {
        "held_out": judged,
        "flat": [{"parameters": dict(f.parameters), "known": f.known} for f in outcome.found.flat],
        "warnings": list(warnings(outcome)),
    }
    write_text(out / "identify.json", json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def draw(outcome: Outcome, path: Path) -> None:
    """Draw prior, draws and mean of each parameter, over the width of its prior."""
    with figure(path, 1, 1, (WIDE, 1.2 + HIGH * len(outcome.found.names))) as (_, axes):
        panel(axes[0, 0], outcome)
        handles = legend(bool(outcome.truth))
        axes[0, 0].legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.25), ncols=4)


def panel(ax: Any, outcome: Outcome) -> None:
    """Draw the parameters on axes, a line each."""
    found, prior = outcome.found, outcome.prior
    sure = found.columns("uncertainty")
    for i, (name, law, before) in enumerate(zip(found.names, found.laws, prior.laws, strict=True)):
        width = before.high - before.low

        def place(value: float, low: float = before.low, width: float = width) -> float:
            return (value - low) / width

        ax.plot([0, 1], [i + UNIFORM] * 2, color=FAINT, linewidth=5, solid_capstyle="butt")
        ends = [place(np.clip(law.mean + s * NINETY * law.std, law.low, law.high)) for s in (-1, 1)]
        ax.plot(ends, [i + NORMAL] * 2, color=COLOURS[5], linewidth=5, solid_capstyle="butt")
        if np.isfinite(sure[i]):
            ends = [place(law.mean + s * NINETY * sure[i]) for s in (-1, 1)]
            ax.plot(ends, [i + MEAN] * 2, color=COLOURS[0], linewidth=2)
        ax.plot([place(law.mean)], [i + MEAN], "o", color=COLOURS[0], markersize=5)
        if name in outcome.truth:
            truth = place(outcome.truth[name])
            ax.plot([truth] * 2, [i + 1.5 * UNIFORM, i + 1.5 * MEAN], color=INK, linewidth=1.2)
    ax.set_yticks(range(len(found.names)), list(found.names))
    ax.invert_yaxis()
    ax.set_xlim(-0.03, 1.03)
    ax.set_xlabel("place in the prior (0: low, 1: high)")


def legend(truth: bool) -> list:
    """Return the legend of the colours, and whether a truth is among them."""
    from matplotlib.lines import Line2D

    kinds = [
        (FAINT, 5, "prior"),
        (COLOURS[5], 5, "90 % of the draws"),
        (COLOURS[0], 2, "mean, 90 % interval"),
    ]
    kinds += [(INK, 1.2, "truth")] if truth else []
    return [Line2D([], [], color=c, linewidth=w, label=text) for c, w, text in kinds]
