"""Evaluation over a grid: a policy on robots it was never trained on, before and after it adapts.

    scores = evaluation.assess(algorithm, seed=0, name="seed 0")
    evaluation.report([scores], seed=0, out=folder)

In each cell of the grid the policy adapts several times, each time from the trained parameters,
with its own perturbations and random numbers. Each result is scored on fresh episodes whose start
noise the adaptation has not seen, and the policy before adaptation on the same episodes, so that
random starts cancel in the difference. Every cell, adaptation and episode is a row of the same
batches. A policy of any algorithm adapts, by the parameters of its actor.
"""

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from sim2real.evaluation.grid import Box, Grid
from sim2real.evaluation.grid_plots import grid_heatmaps, grid_line
from sim2real.evaluation.scores import GridScores, merge_runs
from sim2real.learning.adapt import Identify, PolicyGradient
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.context import training_range
from sim2real.learning.population.from_trained import population_of
from sim2real.learning.population.gradient_adaptation import score_adaptation
from sim2real.learning.population.identification import score_identification
from sim2real.learning.population.population import (
    AdaptationScores,
    Population,
    draw_seeds,
    evaluate_adaptation,
)
from sim2real.runs.checkpoint import FOLDER, find, run_folder
from sim2real.runs.errors import Sim2RealError

log = logging.getLogger(__name__)
ROUNDS = 16  # episodes of a chunk per row: long enough that rows which idle at its end cost little
ROWS = 256  # episodes side by side of a policy whose algorithm has no population
LARGE = 0.95  # share of the cells that gain less than the one whose large gain is filmed
EVALUATION, INTERVALS = 1, 2  # streams of randomness that follow from one seed
Report = Callable[[int, int], None]


class Evaluator(Protocol):
    """An evaluation: `Evaluation` over a grid, `Transfer` on named robots.

    One that has a method `check(algorithm)` is asked before a training, so that what it cannot do
    is refused then.
    """

    def assess(
        self, algorithm: Algorithm, seed: int, name: str, progress: Report | None = None
    ) -> Any:
        """Return the scores of one trained policy.

        Args:
            algorithm: the trained policy and its way to adapt; its environment makes the robots.
            seed: all randomness follows from it; one seed gives different policies the same random
                numbers.
            name: of the training run.
            progress: called with what is done and how much there is, from time to time.
        """
        ...

    def report(self, scores: Sequence[Any], seed: int, out: Path) -> Any:
        """Write the scores of one or several policies into the folder `out`; return them all."""
        ...


@dataclass(frozen=True)
class Evaluation:
    """The cells of an evaluation.

    Raises:
        Sim2RealError: numbers below 1, or a range whose low is above its high.
    """

    grid: Grid  # the robots
    adaptations: int  # independent adaptations in each cell
    episodes: int  # fresh ones that score each adaptation; as many score the policy before it
    threshold: float  # return above which a cell counts as mastered
    draws: int  # resamples of each interval, 2000 to 10000
    # range that the table calls "training range" and the pictures frame, by parameter: [low, high];
    # None: the range that the policy was trained in
    box: Box | None = None

    def __post_init__(self) -> None:
        for name in ("adaptations", "episodes", "draws"):
            if getattr(self, name) < 1:
                raise Sim2RealError(f"eval.{name}={getattr(self, name)} must be at least 1")
        for name, (low, high) in (self.box or {}).items():
            if not low <= high:
                raise Sim2RealError(f"eval.box.{name}: low={low} is above high={high}; swap them")

    def check(self, algorithm: Algorithm) -> None:
        """Raise ParameterError for a grid that leaves the policy's parameter space."""
        check_context_adaptation(algorithm)
        self.grid.values(_Cells(algorithm, self).space)

    def assess(
        self, algorithm: Algorithm, seed: int, name: str, progress: Report | None = None
    ) -> GridScores:
        """Run every cell of the grid; see the module's text, and `Evaluator`.

        Raises:
            ParameterError: a grid that leaves the parameter space of the policy's simulator.
        """
        check_context_adaptation(algorithm)
        cells = _Cells(algorithm, self)
        space = cells.space
        grid, repeats = self.grid, self.adaptations
        values = np.repeat(grid.values(space), repeats, axis=0)  # (C A, P)
        seeds = draw_seeds(np.random.default_rng([seed, EVALUATION]), len(values))
        spent = cells.adaptation_episodes
        work = len(values) * (spent + (2 if spent else 1) * self.episodes)
        log.info("evaluating %d cells, %d episodes", grid.size, work)
        chunks = max(1, min(work // (ROUNDS * cells.num_rows), len(values)))
        parts, steps, done = [], 0, 0
        for chunk in np.array_split(np.arange(len(values)), chunks):
            scores = cells.run(values[chunk], seeds[chunk])
            parts.append(np.stack([scores.before, scores.after]))  # (2, n, E)
            steps, done = steps + scores.steps, done + len(chunk)
            if progress is not None:
                progress(done, len(values))
        shape = (2, 1, grid.size, repeats, -1)  # (2, 1, C, A, E)
        returns = np.concatenate(parts, axis=1).reshape(shape)
        before, after = returns.mean(axis=-1)
        before_sd, after_sd = (
            returns.std(axis=-1, ddof=1)
            if self.episodes > 1
            else np.full_like(returns[..., 0], np.nan)
        )
        box = training_range(algorithm.parts.tasks, space) if self.box is None else self.box
        return GridScores(
            grid,
            grid.parameters(space),
            {p: (float(low), float(high)) for p, (low, high) in box.items() if p in grid.names},
            (name,),
            (algorithm.frames,),
            (steps,),
            self.episodes,
            cells.adaptation_episodes,
            before,
            after,
            before_sd,
            after_sd,
        )

    def robots_to_film(
        self, algorithm: Algorithm, scores: GridScores
    ) -> dict[str, np.ndarray] | None:
        """Return robots whose film tells most, (P,) each: of the median gain and of a large one.

        None where the policy does not adapt. Gains are means over a cell's adaptations.
        """
        if not scores.adaptation_episodes:
            return None
        gains = (scores.after - scores.before).mean(axis=(0, 2))  # (C,)
        order, values = np.argsort(gains), self.grid.values(_Cells(algorithm, self).space)
        found = {}
        for words, share in (("median gain", 0.5), (f"gain above {LARGE:.0%} of all", LARGE)):
            cell = int(order[round(share * (len(order) - 1))])
            found[f"{words} ({gains[cell]:+.0f})"] = values[cell]
        return found

    def report(self, scores: Sequence[GridScores], seed: int, out: Path) -> GridScores:
        """Put one or several runs together, and write what they came to.

        That is grid.csv, evaluation.json, table.md, table.csv, and a picture of one or two axes.
        """
        combined = merge_runs(scores)
        rng = np.random.default_rng([seed, INTERVALS])
        table = combined.summary(self.threshold, self.draws, rng)
        table.write(out / "table")
        summary = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
        combined.write(out, seed=seed, threshold=self.threshold, summary=summary)
        axes = len(combined.grid.axes)
        if axes == 1:
            grid_line(combined, out / "plots" / "line.png", draws=self.draws, rng=rng)
        elif axes == 2:
            grid_heatmaps(combined, out / "plots" / "heatmaps.png")
        else:
            log.info("no picture for a grid of %d axes; see table.md and grid.csv", axes)
        return combined


def check_context_adaptation(algorithm: Algorithm) -> None:
    """Refuse to adapt a policy that receives the true parameters, except by identification.

    Raises:
        Sim2RealError: a policy that knows its robot's parameters, and another adaptation.
    """
    environment, adapt = algorithm.parts.environment, algorithm.parts.adapt
    if environment.context_is_true and adapt.episodes and not isinstance(adapt, Identify):
        context = environment.context_spec
        assert context is not None
        raise Sim2RealError(
            f"{adapt} cannot be evaluated: in simulation this policy already receives the true "
            f"values of {', '.join(context.names)}. Use adapt=none (true values), adapt=identify "
            "(estimates), or transforms.with_params.truth=false (centre of the range) with any "
            "adapt"
        )


class _Cells:
    """Runs cells of a grid: in the algorithm's own population, one of its actor, or its world."""

    def __init__(self, algorithm: Algorithm, evaluation: Evaluation) -> None:
        self._algorithm, self._episodes = algorithm, evaluation.episodes
        self._adapt = algorithm.parts.adapt.bind_environment(algorithm.parts.environment)
        self._trained = algorithm.trained()
        self._made: Population | None = None  # of the actor, where it adapts
        population = algorithm.population
        self.num_rows = population.num_rows if population else ROWS
        self.space = (
            population.space
            if population
            else algorithm.parts.environment.base_rows(1, threads=1).space
        )
        self.adaptation_episodes = self._adapt.episodes

    def run(self, values: np.ndarray, seeds: np.ndarray) -> AdaptationScores:
        """Run robots (n, P) under seeds (n,)."""
        if isinstance(self._adapt, Identify):
            return score_identification(self._trained, self._adapt, values, seeds, self._episodes)
        found = self._algorithm.scores(values, seeds, self._episodes)
        if found is not None:
            return found
        if not self.adaptation_episodes:
            return self._act(values, seeds)
        if isinstance(self._adapt, PolicyGradient):
            return score_adaptation(self._trained, self._adapt, values, seeds, self._episodes)
        adapt = self._adapt.bind_policy(
            self._trained.actor(self._trained.theta), self._trained.critic
        )
        if self._made is None:
            rows = min(ROWS, len(values))
            self._made = population_of(self._trained, rows, critic=adapt.needs_critic)
        theta = self._made.policy.initial(np.random.default_rng(0))  # a trained actor's are its own
        return evaluate_adaptation(self._made, theta, None, adapt, values, seeds, self._episodes)

    def _act(self, values: np.ndarray, seeds: np.ndarray) -> AdaptationScores:
        """Run a policy that does not adapt, with the random numbers of one that does."""
        luck = np.concatenate(
            [draw_seeds(np.random.default_rng(int(seed)), self._episodes) for seed in seeds]
        )
        robots = np.repeat(values, self._episodes, axis=0)  # (n E, P)
        returns, steps = [], 0
        for part in np.array_split(np.arange(len(robots)), -(-len(robots) // ROWS)):
            played = self._trained.run_episodes(luck[part], values=robots[part])
            returns.append(played.returns)
            steps += int(played.lengths.sum())
        scores = np.concatenate(returns).reshape(len(values), -1)  # (n, E)
        return AdaptationScores(scores, scores.copy(), steps)


def find_runs(checkpoint: str | Path | Sequence[str | Path] | None) -> dict[str, Path]:
    """Return the checkpoint files that a user means, by the names of their runs.

    Args:
        checkpoint: a checkpoint file, a run's folder, a folder of runs (a sweep), or several.

    Raises:
        Sim2RealError: none given, or none there.
    """
    if not checkpoint:
        raise Sim2RealError("evaluate needs a trained policy; give checkpoint=PATH")
    given = [checkpoint] if isinstance(checkpoint, str | Path) else list(checkpoint)
    paths = [find(path) for one in given for path in _runs_in(Path(one).expanduser())]
    names = [_seed_name(path) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{name} ({run_folder(path)})" for name, path in zip(names, paths, strict=True)]
    return dict(zip(names, paths, strict=True))


def _runs_in(path: Path) -> list[Path]:
    """Return the run folders below a sweep's folder, or the path itself."""
    if not path.is_dir() or (path / FOLDER).is_dir():
        return [path]
    return sorted(folder.parent for folder in path.glob(f"*/{FOLDER}")) or [path]


def _seed_name(checkpoint: Path) -> str:
    """Name a run by the seed in its manifest, or else by its folder."""
    folder = run_folder(checkpoint)
    try:
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        return f"seed {manifest['seed']}"
    except (OSError, KeyError, TypeError, ValueError):
        return folder.name
