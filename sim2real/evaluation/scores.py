"""Returns of policies in the cells of a grid, before and after adaptation.

    scores = GridScores.read("outputs/evaluate/default/2026-11-21_10-00-00")
    scores.summary(threshold=2000, draws=2000, rng=rng).write("table")
    combine([scores, others])                       # several training runs

The intervals follow from what there is. With several training runs whole runs are resampled,
never cells, since the cells of one run share its policy; repeats within a run are averaged first.
With one run there is no interval over training seeds: its adaptations are resampled within each
cell, each with its episodes, and the table says so.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from envs.params import Parameter
from sim2real.evaluation.grid import Axis, Box, Grid
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.statistics import (
    FEW,
    Interval,
    Statistic,
    bootstrap,
    fraction_above,
    iqm,
    mean,
    wins,
)
from sim2real.runs.tables import Table

MEASURES = ("before_mean", "before_sd", "after_mean", "after_sd")
OVER_RUNS = (
    "Intervals: 95 %, bootstrap over {n} training runs (whole runs are resampled, never cells)"
)
INTERVALS = {
    "runs": OVER_RUNS + ".",
    "few": OVER_RUNS + "; so few runs make them too narrow.",
    "one": "Intervals: 95 %, bootstrap over the {n} adaptations of each cell, with their episodes, "
    "of one training run; they say nothing about another training seed.",
    "none": "One adaptation in each cell of one training run: nothing to resample, no intervals.",
}


class ScoresError(Sim2RealError):
    """Files of scores that are damaged or do not belong together."""


@dataclass(frozen=True)
class GridScores:
    """Returns over a grid of C cells, of R training runs with A adaptations in each cell."""

    grid: Grid  # the cells
    parameters: tuple[Parameter, ...]  # the parameters of the grid's axes
    box: Box  # the training range, for its axes
    runs: tuple[str, ...]  # names of the training runs, R
    frames: tuple[int, ...]  # environment steps that each run was trained for, R
    steps: tuple[int, ...]  # environment steps that the evaluation of each run took, R
    episodes: int  # fresh episodes that score each adaptation, as many before as after it
    adaptation_episodes: int  # episodes that each adaptation spent
    before: np.ndarray  # mean return of the fresh episodes before adaptation, (R, C, A)
    after: np.ndarray  # mean return of the same episodes' seeds after adaptation, (R, C, A)
    before_sd: np.ndarray  # standard deviation of the return over those episodes, (R, C, A)
    after_sd: np.ndarray  # the same after adaptation, (R, C, A)

    @property
    def adaptations(self) -> int:
        """A, independent adaptations in each cell."""
        return self.before.shape[2]

    @property
    def repeats(self) -> int:
        """R, training runs."""
        return len(self.runs)

    def units(self, values: np.ndarray) -> np.ndarray:
        """Arrange values (R, C, A) by what is resampled: (R, C), or (A, C) of a single run."""
        return values.mean(axis=2) if self.repeats > 1 else values[0].T

    def interval(
        self, values: np.ndarray, statistic: Statistic, draws: int, rng: np.random.Generator
    ) -> Interval | float:
        """Estimate a statistic of values (R, C, A), with an interval where one can be had."""
        units = self.units(values)
        if len(units) < 2:
            return float(statistic(units))
        resample = "rows" if self.repeats > 1 else "within_columns"
        return bootstrap(units, statistic, rng, draws=draws, resample=resample)

    def regions(self) -> dict[str, np.ndarray]:
        """Return masks of cells, (C,): all, and those inside and outside the training range."""
        regions = {"whole grid": np.ones(self.grid.size, bool)}
        inside = self.grid.inside(self.box)
        if any(name in self.box for name in self.grid.names) and not inside.all():
            regions["outside the training range"] = ~inside
            if inside.any():
                regions["inside the training range"] = inside
        return regions

    def summary(self, threshold: float, draws: int, rng: np.random.Generator) -> Table:
        """Return the table of returns before and after adaptation, and of what adaptation gained.

        A cell whose return is above the threshold counts as mastered; each interval has `draws`
        resamples.
        """
        columns = ("cells", "policy", "mean return", "IQM", f"share of cells > {threshold:g}")
        table = Table((*columns, "P(improvement)", "training steps"), notes=[self.note()])
        for name, mask in self.regions().items():
            where = f"{name} ({int(mask.sum())})"
            for policy, values in self._policies(mask).items():
                statistics = (mean, iqm, fraction_above(threshold))
                cells = [self.interval(values, statistic, draws, rng) for statistic in statistics]
                table.add(where, policy, *cells, None, float(np.mean(self.frames)))
            if self.adaptation_episodes:
                gain = self.after[:, mask] - self.before[:, mask]
                gained = [self.interval(x, mean, draws, rng) for x in (gain, wins(gain))]
                table.add(where, "gain by adaptation", gained[0], None, None, gained[1], None)
        return table

    def _policies(self, mask: np.ndarray) -> dict[str, np.ndarray]:
        if not self.adaptation_episodes:
            return {"without adaptation": self.before[:, mask]}
        after = f"after {self.adaptation_episodes} episodes of adaptation"
        return {"before adaptation": self.before[:, mask], after: self.after[:, mask]}

    def note(self) -> str:
        """Describe the runs and what the intervals are over."""
        count = self.repeats if self.repeats > 1 else self.adaptations
        kind = "one" if self.repeats == 1 else "few" if self.repeats < FEW else "runs"
        kind = "none" if count == 1 else kind
        runs = f"{self.repeats} training runs" if self.repeats > 1 else "One training run"
        fresh = f"{self.adaptations * self.episodes} fresh episodes in each cell"
        if self.adaptation_episodes:
            each = f"{self.adaptations} adaptations of {self.episodes} each"
            fresh += f" before and after adaptation, {each}"
        return f"{runs}; {fresh}. {INTERVALS[kind].format(n=count)}"

    def csv(self) -> str:
        """Return one row for each run, cell and adaptation."""
        columns = ("run", "cell", *self.grid.names, "adaptation", *MEASURES)
        table = Table((*columns, "episodes", "adaptation_episodes"))
        measures = (self.before, self.before_sd, self.after, self.after_sd)  # (R, C, A) each
        cells = self.grid.cells().tolist()
        for r, c, a in np.ndindex(self.before.shape):
            numbers = [f"{x[r, c, a]:.10g}" for x in measures]
            spent = (self.episodes, self.adaptation_episodes)
            table.add(self.runs[r], c, *cells[c], a, *numbers, *spent)
        return table.csv()

    def description(self) -> dict:
        """Return all that `csv` leaves out, as JSON holds it."""
        axes = [
            {
                "parameter": axis.parameter,
                "where": p.where,
                "unit": p.unit,
                "how": p.how,
                "values": list(axis.values),
            }
            for axis, p in zip(self.grid.axes, self.parameters, strict=True)
        ]
        runs = [
            {"name": name, "training_steps": frames, "evaluation_steps": steps}
            for name, frames, steps in zip(self.runs, self.frames, self.steps, strict=True)
        ]
        box = {name: list(limits) for name, limits in self.box.items()}
        return {"axes": axes, "fixed": self.grid.fixed, "training_range": box, "runs": runs} | {
            "adaptations": self.adaptations,
            "episodes": self.episodes,
            "adaptation_episodes": self.adaptation_episodes,
        }

    def write(self, folder: str | Path, **more: object) -> None:
        """Write grid.csv, and evaluation.json with the description and whatever else is given."""
        write_text(Path(folder) / "grid.csv", self.csv())
        text = json.dumps({"schema": 1, **self.description(), **more}, indent=1)
        write_text(Path(folder) / "evaluation.json", text + "\n")

    @classmethod
    def read(cls, folder: str | Path) -> GridScores:
        """Read what `write` wrote.

        Raises:
            ScoresError: a missing file, or files that do not fit together.
        """
        folder = Path(folder)
        try:
            about = json.loads((folder / "evaluation.json").read_text(encoding="utf-8"))
            with (folder / "grid.csv").open(encoding="utf-8", newline="") as file:
                rows = [[float(row[key]) for key in MEASURES] for row in csv.DictReader(file)]
            axes = [Axis(axis["parameter"], tuple(axis["values"])) for axis in about["axes"]]
            grid = Grid(axes, about["fixed"])
            shape = (len(about["runs"]), grid.size, about["adaptations"], len(MEASURES))
            before, before_sd, after, after_sd = np.moveaxis(np.array(rows).reshape(shape), -1, 0)
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise ScoresError(
                f"{folder}: incomplete evaluation ({error}); evaluate again"
            ) from error
        parameters = tuple(
            Parameter(a["parameter"], a["parameter"], a["where"], unit=a["unit"], how=a["how"])
            for a in about["axes"]
        )
        return cls(
            grid,
            parameters,
            {name: (low, high) for name, (low, high) in about["training_range"].items()},
            tuple(run["name"] for run in about["runs"]),
            tuple(run["training_steps"] for run in about["runs"]),
            tuple(run["evaluation_steps"] for run in about["runs"]),
            about["episodes"],
            about["adaptation_episodes"],
            before,
            after,
            before_sd,
            after_sd,
        )


def merge_runs(parts: Sequence[GridScores]) -> GridScores:
    """Put the runs of several scores, over the same grid and by the same protocol, into one.

    Raises:
        ScoresError: other cells, other numbers of episodes, or none at all.
    """
    if not parts:
        raise ScoresError("there are no scores to combine")
    first = parts[0]
    for part in parts[1:]:
        for what, mine, theirs in _protocol(first, part):
            if mine != theirs:
                raise ScoresError(
                    f"{part.runs[0]} has {what} {theirs}, {first.runs[0]} has {mine}; "
                    "evaluate them alike"
                )
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("before", "after", "before_sd", "after_sd")
    }
    runs, frames, steps = (
        tuple(item for part in parts for item in getattr(part, name))
        for name in ("runs", "frames", "steps")
    )
    return replace(first, runs=runs, frames=frames, steps=steps, **arrays)


def _protocol(first: GridScores, other: GridScores) -> list[tuple[str, object, object]]:
    return [
        ("the axes", first.grid.axes, other.grid.axes),
        ("the fixed values", first.grid.fixed, other.grid.fixed),
        ("the training range", first.box, other.box),
        ("adaptations", first.adaptations, other.adaptations),
        ("fresh episodes", first.episodes, other.episodes),
        ("adaptation episodes", first.adaptation_episodes, other.adaptation_episodes),
    ]
