"""Pictures of a report: bars over each sweep of numbers, and learning curves of the others.

pictures = Pictures(study, "ppo_source", out, draws=2000, seed=0).draw()
pictures[0]                 # ("plots/sweep_udr.png", "udr over width, after 300,000 steps; ...")
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sim2real.evaluation.study import Group, Study
from sim2real.runs import figures as plots
from sim2real.runs.statistics import Interval, bootstrap, iqm

INK, BAR, EDGE = plots.INK, plots.COLOURS[0], plots.COLOURS[1]
KL = "train/kl"
# names of pictures, and of no others
DRAWN = ("sweep_*.png", "learning_curves*.png", "divergence_*.png")
CURVES = len(plots.COLOURS)  # lines that one picture can distinguish


@dataclass(frozen=True)
class Pictures:
    """The pictures that the runs of a study allow."""

    study: Study  # the runs
    baseline: str | None  # the experiment that each sweep is compared with
    out: Path  # the report's folder
    draws: int  # resamples of each interval
    seed: int  # the seed of the resamples

    def draw(self) -> list[tuple[str, str]]:
        """Draw them all, and return their paths below `out` and captions."""
        pictures, barred = [], set()
        for experiment in dict.fromkeys(group.experiment for group in self.study.groups):
            groups = self.study.find(experiment)
            keys = list(groups[0].swept)
            values = [next(iter(group.swept.values()), None) for group in groups]
            if len(keys) == 1 and len(groups) > 1 and all(_is_number(value) for value in values):
                pictures.append(self._sweep(groups, keys[0]))
                barred.add(experiment)
        rest = [g for g in self.study.groups if g.experiment not in barred and _curves(g)]
        for kind, main in _kinds(rest, self.baseline).items():
            lines = [line for group in main for line in _lines(group)]
            for part in range(0, len(lines), CURVES):
                some = dict(lines[part : part + CURVES])
                pictures += self._learning(some, f"{kind}{part or ''}")
        for old in list_figures(self.out) - {self.out / place for place, _ in pictures}:
            old.unlink()  # of fewer runs
        return pictures

    def _sweep(self, groups: Sequence[Group], key: str) -> tuple[str, str]:
        """Draw bars over a sweep on each robot, between the baseline and training on that robot."""
        rng, robots = np.random.default_rng(self.seed), self.study.robots
        budget = max(set.intersection(*(set(group.runs) for group in groups)), default=None)
        experiment = groups[0].experiment
        name, place = key.rpartition(".")[2], f"plots/sweep_{experiment}.png"
        size = ((0.4 * (len(groups) + 2) + 1.0) * len(robots), 3.6)  # inches
        with plots.figure(self.out / place, 1, len(robots), size) as (_, axes):
            for ax, robot in zip(axes[0], robots, strict=True):
                bars = self._bars(groups, robot, budget)
                for x, (_, values, colour) in enumerate(bars):
                    _bar(ax, x, values, colour, self.draws, rng)
                labels = [label for label, _, _ in bars]
                ax.set_xticks(range(len(bars)), labels, rotation=50, ha="right")
                ax.set_title(f"tested on {robot}")
                ax.set_xlabel(f"{experiment}: {name}")
                ax.grid(axis="y")
            axes[0, 0].set_ylabel("Return (IQM over runs)")
            top = max(ax.get_ylim()[1] for ax in axes[0])
            for ax in axes[0]:
                ax.set_ylim(top=top)
        after = "after different numbers of steps" if budget is None else f"after {budget:,} steps"
        return place, f"{experiment} over {name}, {after}; dots are runs, lines 95 % intervals"

    def _bars(
        self, groups: Sequence[Group], robot: str, budget: int | None
    ) -> list[tuple[str, np.ndarray, str]]:
        returns = self.study.returns
        bars = [
            (_text(next(iter(group.swept.values()))), returns(group, robot, budget), BAR)
            for group in groups
        ]
        reference = self.study.find(self.baseline) if self.baseline else []
        other = [g for g in self.study.groups if g.trained_on != groups[0].trained_on]
        above = [g for g in other if g.trained_on == robot]
        for group in [*reference[:1], *above[:1]]:
            where = 0 if group in reference else len(bars)
            shared = budget if budget in group.runs else max(group.runs)
            own = "" if shared == budget else f"\n({shared / 1000:.0f}k steps)"
            bars.insert(where, (group.label + own, returns(group, robot, shared), EDGE))
        return bars

    def _learning(self, curves: dict[str, list[Path]], kind: str) -> list[tuple[str, str]]:
        """Draw returns during training, and the divergences of updates where all have them."""
        suffix = f"_{kind}" if kind else ""
        how: Any = {"draws": self.draws, "seed": self.seed}
        place = f"plots/learning_curves{suffix}.png"
        plots.learning_curve(curves, self.out / place, **how)
        pictures = [(place, "Return during training, mean over runs with 95 % intervals")]
        files = [file for own in curves.values() for file in own]
        if kind.startswith("settings") and all(_has(file, KL) for file in files):
            place = f"plots/divergence{suffix}.png"
            plots.learning_curve(curves, self.out / place, y=KL, **how)
            pictures.append((place, "Divergence of the policy in an update"))
        return pictures


def list_figures(folder: Path) -> set[Path]:
    """Return the paths of a report's pictures in a folder."""
    return {path for name in DRAWN for path in (folder / "plots").glob(name)}


def _bar(
    ax: Any, x: int, values: np.ndarray, colour: str, draws: int, rng: np.random.Generator
) -> None:
    middle: Interval | float = float(iqm(values[:, None]))
    if len(values) > 1:
        middle = bootstrap(values[:, None], iqm, rng, draws=draws, resample="rows")
        ax.plot([x, x], [middle.low, middle.high], color=INK, linewidth=1.6)
    ax.bar(x, middle.value if isinstance(middle, Interval) else middle, 0.66, color=colour)
    spread = np.linspace(-0.18, 0.18, len(values)) if len(values) > 1 else [0.0]
    ax.plot(x + np.array(spread), values, ".", color=INK, markersize=3, alpha=0.55)


def _kinds(main: Sequence[Group], baseline: str | None) -> dict[str, list[Group]]:
    """Group the runs that are drawn together: by robot and by settings of the training.

    The baseline stands in both.
    """
    first = [group for group in main if group.experiment == baseline]
    others = [group for group in main if group not in first]
    if not first:
        return {"": others} if others else {}
    plain = _training(first[0])
    robots = [group for group in others if _training(group) == plain]
    settings = [group for group in others if _training(group) != plain]
    return {
        kind: first + groups
        for kind, groups in (("robots", robots), ("settings", settings))
        if groups or kind == "robots"
    }


def _training(group: Group) -> dict[str, Any]:
    return {k: v for k, v in group.settings.items() if k.startswith(("algorithm.", "policy."))}


def _lines(group: Group) -> list[tuple[str, list[Path]]]:
    """Return a group's lines, with their names: its runs, and more runs up to fewer steps."""
    shown = group.reported_budgets()
    return [
        (group.label if len(shown) == 1 else f"{group.label} to {budget:,}", _curves(group, budget))
        for budget in shown
    ]


def _has(file: Path, column: str) -> bool:
    with file.open(encoding="utf-8") as lines:
        return column in next(lines, "").strip().split(",")


def _curves(group: Group, budget: int | None = None) -> list[Path]:
    files = [run.folder / "metrics.csv" for run in group.runs_at_budget(budget)]
    return [file for file in files if file.is_file()]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)
