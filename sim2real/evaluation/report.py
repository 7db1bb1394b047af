"""The report of a transfer study over many training runs: tables, claims, pictures.

    python -m sim2real run=report runs=outputs/train
    python -m sim2real run=report runs=[outputs/train/udr,outputs/train/ppo_source]

Runs that were evaluated with `eval=transfer` are put into groups: an experiment, and what was swept
within it. The report is report.md with report.csv (one row for each group and robot),
returns.csv (one for each run and robot), claims.csv, and pictures: learning curves, and bars over
each sweep. Everything is over training runs: intervals resample whole runs, since episodes of one
policy say nothing about the next.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim2real.evaluation.hypotheses import Claim, ClaimResult
from sim2real.evaluation.study import Group, Run, Study
from sim2real.runs.statistics import FEW, Interval, bootstrap, iqm, probability_of_improvement
from sim2real.runs.tables import Cell, Table

DRAWS = 5000  # resamples of each interval
FIGURES = "figures"


@dataclass(frozen=True)
class Report:
    """What the runs of a study say, compared with a baseline."""

    study: Study  # the groups of runs
    baseline: str | None  # the experiment that every row is compared with; None for no comparison
    seed: int  # of the bootstrap

    def main_table(self) -> Table:
        """Return a row for each group: what it gets on each robot, and what the study got there."""
        robots = self.study.robots
        columns = ["experiment", "trained on", "runs", "steps", *(f"IQM on {r}" for r in robots)]
        compared = [f"P(better than {self.baseline} on {robots[-1]})"] if self.baseline else []
        table = Table([*columns, *compared, *(f"the study: {robot}" for robot in robots)])
        for group, budget in _shown(self.study):
            returns = [self.study.returns(group, robot, budget) for robot in robots]
            chance = [self._chance(group, robots[-1], budget)] if self.baseline else []
            figures = [_figure_words(group, robot) for robot in robots]
            own = (group.label, group.trained_on, *_size(group, budget))
            table.add(*own, *map(self._iqm, returns), *chance, *figures)
        return table

    def pair_table(self, trained: str | None, tested: str) -> Table:
        """Return a row for each group that was trained on one robot, tested on another."""
        columns = ["experiment", "runs", "steps", "IQM", "mean", "sd over runs", "sd over episodes"]
        compared = [f"P(better than {self.baseline})"] if self.baseline else []
        table = Table([*columns, *compared, "the study: mean", "its sd over episodes"])
        for group, budget in _shown(self.study):
            if group.trained_on == trained:
                chance = [self._chance(group, tested, budget)] if self.baseline else []
                numbers = self._numbers(group, tested, budget)
                own = (group.label, *_size(group, budget))
                table.add(*own, *numbers, *chance, *_figure(group, tested))
        return table

    def long_table(self) -> Table:
        """Return a row for each group, budget and robot."""
        columns = ("experiment", "trained on", "tested on", "runs", "steps")
        numbers = ("IQM", "mean", "sd over runs", "sd over episodes", "P(improvement)")
        table = Table((*columns, *numbers, "study mean", "study sd"))
        for group in self.study.groups:
            for budget in sorted(group.runs):
                for robot in self.study.robots:
                    cells = self._numbers(group, robot, budget)
                    chance = self._chance(group, robot, budget)
                    own = (group.label, group.trained_on, robot, *_size(group, budget))
                    table.add(*own, *cells, chance, *_figure(group, robot))
        return table

    def markdown(
        self, runs: Sequence[Run], claims: Table, pictures: Sequence[tuple[str, str]]
    ) -> str:
        """Return the report as Markdown."""
        table = self.main_table().markdown().strip()
        parts = [f"# Transfer: {self.study.task}", table, _note(self.study, runs)]
        parts += [f"![{text}]({path})\n\n*{text}.*" for path, text in pictures]
        if claims.rows:
            parts += ["## What was expected", claims.markdown().strip()]
        for trained, tested in robot_pairs(self.study):
            table = self.pair_table(trained, tested).markdown().strip()
            parts += [f"## {trained or 'another robot'} → {tested}", table]
        return "\n\n".join(parts) + "\n"

    def _iqm(self, values: np.ndarray) -> Interval | float:
        """Return the interquartile mean of runs (n,), with an interval from two runs up."""
        if len(values) < 2:
            return float(iqm(values[:, None]))
        rng = np.random.default_rng(self.seed)  # anew: a number has one interval in all tables
        return bootstrap(values[:, None], iqm, rng, draws=DRAWS, resample="rows")

    def _numbers(self, group: Group, robot: str, budget: int) -> list[Cell]:
        values = self.study.returns(group, robot, budget)
        spread = float(values.std(ddof=1)) if len(values) > 1 else None
        every = [run.scores.returns[robot] for run in group.runs_at_budget(budget)]
        within = float(np.mean([_spread(returns) for returns in every]))
        return [self._iqm(values), float(values.mean()), spread, within]

    def _chance(self, group: Group, robot: str, budget: int) -> Interval | None:
        """Return how probably a run of the group beats one of the baseline after as many steps."""
        others = self.study.find(self.baseline) if self.baseline else []
        if len(others) != 1 or others[0] is group or budget not in others[0].runs:
            return None
        mine, theirs = (self.study.returns(g, robot, budget)[:, None] for g in (group, others[0]))
        if min(len(mine), len(theirs)) < 2:
            return None
        rng = np.random.default_rng(self.seed)
        return probability_of_improvement(mine, theirs, rng, draws=DRAWS)


def claims_table(study: Study, verdicts: Sequence[ClaimResult]) -> Table:
    """Return the verdict of each claim, with the figures of the study."""
    table = Table(("claim", "verdict", "found", "steps", "the study"))
    for claim, verdict, found, steps in verdicts:
        table.add(claim.text, verdict, found, steps or None, _studied(study, claim))
    return table


def _studied(study: Study, claim: Claim) -> str | None:
    """Return the study's figures for both sides of a claim, where there are any."""
    words = []
    for side in (side for side in (claim.left, claim.right) if side is not None):
        groups = study.find(side.experiment, side.when)
        mean = _figure(groups[0], side.robot)[0] if groups and side.robot else None
        if mean is None:
            return None
        words.append(f"{mean:g}")
    factor = "" if claim.times == 1 else f"{claim.times:g} x "
    return f" against {factor}".join(words)


def returns_csv(study: Study) -> str:
    """Return one row for each run, budget and robot."""
    names = ("experiment", "run", "trained_on", "tested_on", "steps", "episodes")
    table = Table((*names, "mean_return", "sd_over_episodes"))
    for group in study.groups:
        for run in (run for budget in sorted(group.runs) for run in group.runs_at_budget(budget)):
            for robot, returns in run.scores.returns.items():
                own = [group.label, run.scores.name, run.scores.trained_on, robot]
                numbers = [f"{returns.mean():.6g}", f"{_spread(returns):.6g}"]
                table.add(*own, run.scores.frames, len(returns), *numbers)
    return table.csv()


def _shown(study: Study) -> list[tuple[Group, int]]:
    return [(group, budget) for group in study.groups for budget in group.reported_budgets()]


def _size(group: Group, budget: int) -> tuple[int, float]:
    runs = group.runs_at_budget(budget)
    return len(runs), float(np.mean([run.scores.frames for run in runs]))


def _spread(returns: np.ndarray) -> float:
    return float(returns.std(ddof=1)) if len(returns) > 1 else float("nan")


def _figure(group: Group, robot: str) -> tuple[float | None, float | None]:
    """Return the study's mean and standard deviation for a group on a robot, if it has any."""
    newest = group.runs_at_budget()[-1]
    for figure in newest.expect.get(FIGURES, ()):
        when = figure.get("when") or {}
        if robot in figure and group.matches(group.experiment, when):
            mean, spread = figure[robot]
            return float(mean), float(spread)
    return None, None


def _figure_words(group: Group, robot: str) -> str | None:
    mean, spread = _figure(group, robot)
    return None if mean is None or spread is None else f"{mean:g} ± {spread:g}"


def robot_pairs(study: Study) -> list[tuple[str | None, str]]:
    """Return the pairs of robots that a study compares: of training and of evaluation."""
    trained = dict.fromkeys(group.trained_on for group in study.groups)
    order = [robot for robot in study.robots if robot in trained]
    return [(one, other) for one in [*order, *(t for t in trained if t not in order)]
            for other in study.robots]  # fmt: skip


def _note(study: Study, runs: Sequence[Run]) -> str:
    """Return how the numbers came about, in words."""
    episodes = sorted({len(r) for run in runs for r in run.scores.returns.values()})
    counts = [len(group.runs_at_budget()) for group in study.groups]
    settings = runs[0].settings
    facts = {
        "masses": settings.get("env.task.masses"),
        "steps an episode": settings.get("env.task.max_steps"),
        "MuJoCo": _versions(runs),
    }
    words = ", ".join(f"{name} {value}" for name, value in facts.items() if value)
    few = f"; fewer than {FEW} runs make them too narrow" if min(counts) < FEW else ""
    return (
        f"Each run: the mean of {' or '.join(map(str, episodes))} deterministic episodes of its "
        "last policy on each robot. IQM: interquartile mean over runs; intervals: 95 %, bootstrap "
        f"over runs{few}. P: share of pairs of runs in which the first has the higher return. "
        f"The study's ± is over the episodes of one policy. {study.task}: {words}."
    )


def _versions(runs: Sequence[Run]) -> str:
    found: dict[str, Any] = {}
    for run in runs:
        try:
            text = (run.folder / "manifest.json").read_text(encoding="utf-8")
            found[json.loads(text)["packages"]["mujoco"]] = True
        except (OSError, KeyError, TypeError, ValueError):
            continue
    return " and ".join(found)
