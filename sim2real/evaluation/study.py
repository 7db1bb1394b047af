"""Training runs that were evaluated on named robots, found in folders and put into groups.

    study = Study(collect(["outputs/train/udr", "outputs/train/ppo_source"]))
    for group in study.groups:
        group.label                             # "udr width=0.05"
        study.returns(group, "target")          # (runs,): the mean return of each

A group is an experiment with the same settings; its runs differ by their seeds. What was swept is
found by comparing the settings of an experiment's runs. A run may have been evaluated after
different numbers of steps; steps within a tenth of each other count as one budget, since a run ends
with a whole iteration.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from sim2real.evaluation.transfer import TransferScores, read
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.metrics import MetricsFile
from sim2real.runs.settings import decisive
from sim2real.runs.tree import flatten

PATTERN = "transfer-*.json"
SAME = 1.1  # ratio up to which two numbers of steps are one budget
Take = Literal["max", "last"]


class RunsError(Sim2RealError):
    """Folders without evaluated runs, or runs that do not belong into one table."""


@dataclass(frozen=True)
class Run:
    """One training run, evaluated after some number of steps."""

    folder: Path  # the folder of its files
    experiment: str  # its name, or "default"
    # what decided its result other than the seed, as {"params.width": 0.075}
    settings: dict[str, Any]
    expect: dict[str, Any]  # what the experiment expected; see `sim2real.evaluation.hypotheses`
    scores: TransferScores  # what it got on each robot


@dataclass
class Group:
    """Runs of one experiment with the same settings."""

    experiment: str  # its name
    swept: dict[str, Any]  # the settings in which it differs from other groups of the experiment
    # its runs, at each budget by the seed's name
    runs: dict[int, dict[str, Run]] = field(default_factory=dict)
    twin: int = 1  # number among groups whose labels would be equal otherwise, from 1 up

    @property
    def label(self) -> str:
        """Name in tables and pictures: the experiment, and numbers and words that were swept."""
        parts = [_brief(*item) for item in self.swept.items()]
        number = f"({self.twin})" if self.twin > 1 else ""
        return " ".join(part for part in [self.experiment, *parts, number] if part)

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that decided the results, equal in all runs."""
        return next(run.settings for found in self.runs.values() for run in found.values())

    @property
    def trained_on(self) -> str | None:
        """The robot of the training."""
        return next(r.scores.trained_on for found in self.runs.values() for r in found.values())

    def runs_at_budget(self, budget: int | None = None) -> list[Run]:
        """Return the runs of a budget, None for the largest, in the order of their seeds."""
        found = self.runs.get(max(self.runs) if budget is None else budget, {})
        return [found[name] for name in sorted(found, key=_natural)]

    def reported_budgets(self) -> list[int]:
        """Return the budgets to show: the largest, and smaller ones that more runs reached."""
        found: list[int] = []
        for budget in sorted(self.runs, reverse=True):
            if not found or len(self.runs[budget]) > len(self.runs[found[0]]):
                found.insert(0, budget)
        return found

    def matches(self, experiment: str, when: Mapping[str, Any]) -> bool:
        """Return whether the group is of an experiment and has certain settings."""
        return self.experiment == experiment and all(
            self.settings.get(key) == value for key, value in when.items()
        )


class Study:
    """Groups of runs on the same robots.

    Raises:
        RunsError: runs of different tasks or robots.
    """

    def __init__(self, runs: Sequence[Run]) -> None:
        first = runs[0]
        for run in runs:
            mine, theirs = (
                (r.scores.task, r.scores.robots, _fixed(r.settings)) for r in (first, run)
            )
            if mine != theirs:
                raise RunsError(
                    f"{run.folder} was evaluated on {_words(run)}, {first.folder} on "
                    f"{_words(first)}; report them separately: runs= takes folders of one task"
                )
        self.task, self.robots = first.scores.task, tuple(first.scores.robots)
        self._budget = budgets(run.scores.frames for run in runs)
        self.groups = self._grouped(runs)

    def _grouped(self, runs: Sequence[Run]) -> list[Group]:
        groups: dict[str, Group] = {}
        for experiment in sorted({run.experiment for run in runs}):
            own = [run for run in runs if run.experiment == experiment]
            keys = _differing([run.settings for run in own])
            for run in sorted(own, key=lambda r: [_natural(r.settings.get(k)) for k in keys]):
                swept = {key: run.settings.get(key) for key in keys}
                group = groups.setdefault(
                    f"{experiment} {json.dumps(swept)}", Group(experiment, swept)
                )
                named = group.runs.setdefault(self._budget[run.scores.frames], {})
                named[run.scores.name] = run
        seen: Counter[str] = Counter()
        for group in groups.values():
            seen[group.label] += 1
            group.twin = seen[group.label]
        return list(groups.values())

    def find(self, experiment: str, when: Mapping[str, Any] | None = None) -> list[Group]:
        """Return the groups of an experiment that have certain settings."""
        return [group for group in self.groups if group.matches(experiment, when or {})]

    def returns(self, group: Group, robot: str, budget: int | None = None) -> np.ndarray:
        """Return each run's mean return on a robot, (runs,)."""
        return np.array([run.scores.returns[robot].mean() for run in group.runs_at_budget(budget)])

    def metric(self, group: Group, column: str, take: Take, budget: int | None) -> np.ndarray:
        """Return the largest or the last value of a column of each run's metrics.csv, (runs,).

        Raises:
            RunsError: a run without that file or column.
        """
        return np.array([_metric(run, column, take) for run in group.runs_at_budget(budget)])


def collect(paths: Iterable[str | Path]) -> list[Run]:
    """Find the evaluated runs in folders, at any depth.

    Of several evaluations of one training after the same steps the newest counts.

    Raises:
        RunsError: a folder that is not there, or without evaluated runs; a run without its
            configuration.
        TransferError: a damaged file of scores.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        found = sorted(path.expanduser().rglob(PATTERN)) if path.expanduser().is_dir() else []
        if not found:
            why = "holds no evaluated run" if path.expanduser().exists() else "does not exist"
            raise RunsError(
                f"runs={path} {why}; give folders of runs that were trained or evaluated with "
                "eval=transfer"
            )
        files += found
    files = sorted(set(files), key=lambda file: file.stat().st_mtime)
    return [run for file in files for run in _runs(file)]


def budgets(frames: Iterable[int]) -> dict[int, int]:
    """Return for each number of steps the smallest one that counts as the same budget."""
    found: dict[int, int] = {}
    start = 0
    for steps in sorted(set(frames)):
        if not found or steps > SAME * start:
            start = steps
        found[steps] = start
    return found


def _runs(file: Path) -> list[Run]:
    folder = file.parent
    try:
        tree = yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8"))
        settings = flatten(decisive(tree))
        expect = dict(tree.get("expect") or {})
    except (OSError, AttributeError, TypeError, ValueError, yaml.YAMLError) as error:
        raise RunsError(
            f"{folder} has scores but no readable config.yaml ({error}); leave it out of runs="
        ) from error
    return [Run(folder, _experiment(folder), settings, expect, scores) for scores in read(file)]


def _experiment(folder: Path) -> str:
    path = folder / ".hydra" / "overrides.yaml"
    lines = yaml.safe_load(path.read_text(encoding="utf-8")) if path.is_file() else []
    names = [line.partition("=")[2] for line in lines if line.lstrip("+").startswith("experiment=")]
    return names[-1] if names else "default"


def _brief(key: str, value: Any) -> str:
    """Return "width=0.1", "params=Randomization" for a class, "" for what is absent or long."""
    place, _, name = key.rpartition(".")
    if name == "_target_":
        return f"{place.rpartition('.')[2]}={str(value).rpartition('.')[2]}"
    return "" if value is None or isinstance(value, list | dict) else f"{name}={value}"


def _fixed(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that must be equal in a table: the environment without the robots."""
    return {key: settings.get(key) for key in ("env.task.masses", "env.task.max_steps", "effects")}


def _words(run: Run) -> str:
    details = {k.rpartition(".")[2]: v for k, v in _fixed(run.settings).items() if v is not None}
    return f"{run.scores.task} as {', '.join(run.scores.robots)} ({details})"


def _differing(all_settings: Sequence[Mapping[str, Any]]) -> list[str]:
    keys = dict.fromkeys(key for settings in all_settings for key in settings)
    return [k for k in keys if len({json.dumps(s.get(k), default=str) for s in all_settings}) > 1]


def _natural(value: Any) -> tuple[int, float, str]:
    """Sort numbers by size, also those at the end of a name, and before other text."""
    text = str(value)
    number = text.rpartition(" ")[2]
    try:
        return (0, float(number), text)
    except ValueError:
        return (1, 0.0, text)


def _metric(run: Run, column: str, take: Take) -> float:
    path = run.folder / "metrics.csv"
    rows = MetricsFile(path).rows()
    values = [
        float(row[column])
        for row in rows
        if row.get(column) and float(row["train/frames"]) <= run.scores.frames
    ]
    if not values:
        raise RunsError(f"{path} has no {column}; train again, or leave the run out")
    return float(np.nanmax(values)) if take == "max" else values[-1]
