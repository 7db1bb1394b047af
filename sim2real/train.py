"""The verb `train`: improve a policy until its budget is spent, then evaluate and show it.

    python -m sim2real +experiment=esmaml
    python -m sim2real +experiment=esmaml resume=outputs/train/esmaml/2026-11-21_10-00-00

A resumed run computes, to the last bit, what an uninterrupted one would have: it starts from the
newest checkpoint of the run that it continues (or the one that is named), takes over its rows of
metrics.csv up to there, and goes on in its own folder. Wall-clock numbers are in timing.csv, apart,
because they cannot repeat.

Ctrl-C or SIGTERM: the iteration in progress is finished, a checkpoint written, and one line says
how to resume. A second Ctrl-C abandons the iteration. On a full disk the run stops; its checkpoints
up to there are whole.
"""

from __future__ import annotations

import inspect
import logging
import signal
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from envs.randomization import Tasks
from envs.rows import Rows
from sim2real import plots
from sim2real.adapt import Adaptation
from sim2real.algorithms.base import Algorithm
from sim2real.checkpoint import FOLDER, CheckpointStore, find, restore, run_folder
from sim2real.errors import CheckpointError, DiskError, RenderError, Sim2RealError, Stopped
from sim2real.evaluate import Evaluation, evaluate_grid
from sim2real.metrics import MetricsFile
from sim2real.policy import MLPPolicy
from sim2real.progress import Progress
from sim2real.stopping import Stopping
from sim2real.video import Video

log = logging.getLogger(__name__)
STEP = "train/iteration"


def run(
    *,
    env: Callable[..., Rows],
    params: Tasks,
    policy: Callable[..., MLPPolicy],
    adapt: Adaptation,
    algorithm: Callable[..., Algorithm],
    eval: Evaluation | None,
    logger: Any,
    seed: int,
    device: str | torch.device,
    iterations: int | None,
    frames: int | None,
    checkpoint_every: int,
    keep_checkpoints: int,
    resume: str | Path | None,
    video: Video | None,
    out: Path,
) -> Algorithm:
    """Train.

    Args:
        env: makes the environment; see `ESMAML`.
        params: the tasks to train on.
        policy: makes the policy.
        adapt: how it adapts.
        algorithm: makes the algorithm from those of env, tasks, policy, adapt, seed and device that
            it takes.
        eval: what to evaluate afterwards; None for nothing.
        logger: further loggers.
        seed: all randomness follows from it.
        device: where networks are.
        iterations: iterations in all, those before a resume included; None for no limit.
        frames: environment steps after which no further iteration starts; None for no limit.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay; the best stays too.
        resume: a run folder or a checkpoint to continue; None starts afresh.
        video: the film of the trained policy; None for none.
        out: the run's folder.

    Returns:
        The trained algorithm.

    Raises:
        Sim2RealError: input that cannot work, before any work starts.
        DiskError: when the run's files could not be written.
        Stopped: after a signal.
    """
    budget = Budget(iterations, frames)
    if checkpoint_every < 1:
        raise Sim2RealError(f"checkpoint_every={checkpoint_every} must be at least 1 iteration")
    source = None if resume is None else find(resume)
    learner = build(
        algorithm, env=env, tasks=params, policy=policy, adapt=adapt, seed=seed, device=device
    )
    files = RunFiles(Path(out), identity(learner, env), checkpoint_every, keep_checkpoints)
    files.begin(learner, source)
    learn(learner, budget, files)
    try:
        finish(learner, files, env, eval, video, seed)
    except KeyboardInterrupt:
        raise _stopped(
            files, "training is complete, its evaluation is not", signal.SIGINT
        ) from None
    return learner


@dataclass(frozen=True)
class Budget:
    """When training is over: the first of the limits that is reached.

    Args:
        iterations: iterations in all, or None.
        frames: environment steps, or None.

    Raises:
        Sim2RealError: without a limit, or for one below 0.
    """

    iterations: int | None
    frames: int | None

    def __post_init__(self) -> None:
        limits = {"iterations": self.iterations, "frames": self.frames}
        if all(limit is None for limit in limits.values()):
            raise Sim2RealError("training has no end: set iterations, frames, or both")
        for name, limit in limits.items():
            if limit is not None and limit < 0:
                raise Sim2RealError(f"{name}={limit} must not be negative")

    def done(self, algorithm: Algorithm) -> bool:
        """Return whether a limit is reached."""
        enough = self.iterations is not None and algorithm.iteration >= self.iterations
        return enough or (self.frames is not None and algorithm.frames >= self.frames)

    def progress(self, algorithm: Algorithm) -> Progress:
        """Return the bar of a run that is here."""
        if self.iterations is not None:
            return Progress(self.iterations, "iteration", algorithm.iteration, algorithm.frames)
        assert self.frames is not None
        return Progress(self.frames, "step", algorithm.frames, algorithm.frames)

    def spent(self, algorithm: Algorithm) -> int:
        """Return what `progress` counts."""
        return algorithm.iteration if self.iterations is not None else algorithm.frames


class RunFiles:
    """What a run keeps in its folder while it trains: metrics.csv, timing.csv and checkpoints.

    Args:
        out: the folder.
        identity: what a checkpoint must share with a run that continues it.
        every: iterations between checkpoints.
        keep: how many of the newest checkpoints stay.
    """

    def __init__(self, out: Path, identity: dict[str, Any], every: int, keep: int) -> None:
        self.out, self.identity = out, identity
        self.metrics, self.timing = (
            MetricsFile(out / "metrics.csv"),
            MetricsFile(out / "timing.csv"),
        )
        self.store = CheckpointStore(out / FOLDER, keep)
        self._every, self._saved, self._score = every, 0, float("nan")

    def begin(self, algorithm: Algorithm, source: Path | None) -> None:
        """Start afresh, or from the checkpoint `source` of another run or of this one.

        Raises:
            CheckpointError: for a checkpoint that does not fit, or a folder that already holds a
                run.
        """
        if source is None:
            if newest := self.store.latest():
                raise CheckpointError(
                    f"{self.out} already holds a run; continue it with resume={newest}"
                )
            return
        restore(source, algorithm, self.identity)
        self._saved = algorithm.iteration
        former = run_folder(source)
        with self.writing():
            self.out.mkdir(parents=True, exist_ok=True)
            self.store.adopt(source)
            for file in (self.metrics, self.timing):
                file.cut(STEP, algorithm.iteration, MetricsFile(former / file.path.name))
        log.info("continuing %s after iteration %d", source, algorithm.iteration)

    def record(
        self, algorithm: Algorithm, metrics: dict[str, float], seconds: float, steps: int
    ) -> None:
        """Write the rows of an iteration of so many seconds and steps; and a checkpoint if due."""
        self._score = metrics.get("train/return", float("nan"))
        step = {STEP: algorithm.iteration}
        with self.writing():
            self.out.mkdir(parents=True, exist_ok=True)
            self.metrics.write(step | metrics)
            self.timing.write(
                step | {"time/seconds": seconds, "time/fps": steps / max(seconds, 1e-9)}
            )
        if algorithm.iteration >= self._saved + self._every:
            self.save(algorithm)

    def save(self, algorithm: Algorithm) -> None:
        """Write a checkpoint of the present state, unless there is one."""
        if algorithm.iteration > self._saved:
            facts = {**self.identity, "frames": algorithm.frames, "train/return": self._score}
            self.store.save(algorithm, algorithm.iteration, facts, self._score)
            self._saved = algorithm.iteration

    @contextmanager
    def writing(self) -> Any:
        """Say in one sentence what it means that a file could not be written."""
        try:
            yield
        except OSError as error:
            newest = self.store.latest()
            resume = f"continue with resume={newest}" if newest else "nothing was saved yet"
            raise DiskError(
                f"the run's files in {self.out} could not be written ({error.strerror or error}); "
                f"the run stops; free some space, then {resume}"
            ) from error


def build(algorithm: Callable[..., Algorithm], **parts: Any) -> Algorithm:
    """Make the algorithm from those parts that it takes."""
    takes = inspect.signature(algorithm).parameters
    return algorithm(**{name: part for name, part in parts.items() if name in takes})


def identity(algorithm: Algorithm, env: Callable[..., Rows]) -> dict[str, Any]:
    """Return what tells whether a checkpoint fits: the task's name and the policy's shape."""
    keywords = getattr(env, "keywords", {})
    task = (
        type(keywords["task"]).__name__
        if "task" in keywords
        else getattr(env, "func", env).__name__
    )
    return {
        "task": task,
        "algorithm": type(algorithm).__name__,
        "policy": dict(getattr(getattr(algorithm, "policy", None), "shape", {})),
    }


def learn(algorithm: Algorithm, budget: Budget, files: RunFiles) -> None:
    """Iterate until the budget is spent, keeping the run's files.

    Raises:
        Stopped: after a signal; see the module's text.
    """
    with Stopping() as stopping, budget.progress(algorithm) as progress:
        while not budget.done(algorithm) and not stopping.signal:
            start, steps = time.monotonic(), algorithm.frames
            try:
                metrics = algorithm.iterate()
            except KeyboardInterrupt:
                raise _stopped(
                    files, "the iteration in progress was abandoned", stopping.signal
                ) from None
            files.record(algorithm, metrics, time.monotonic() - start, algorithm.frames - steps)
            progress.update(
                budget.spent(algorithm), algorithm.frames, metrics.get("train/return", float("nan"))
            )
        files.save(algorithm)
    if stopping.signal:
        raise _stopped(files, f"stopped after iteration {algorithm.iteration}", stopping.signal)


def _stopped(files: RunFiles, what: str, number: int) -> Stopped:
    newest = files.store.latest()
    how = (
        f"to continue, run the same command with resume={newest}"
        if newest
        else "no checkpoint was written yet"
    )
    return Stopped(f"{what}; {how}", 128 + number)


def finish(
    algorithm: Algorithm,
    files: RunFiles,
    env: Callable[..., Rows],
    evaluation: Evaluation | None,
    video: Video | None,
    seed: int,
) -> None:
    """Draw the learning curve, film the policy and evaluate it; all is already saved."""
    if files.metrics.path.exists():
        plots.learning_curve({"": [files.metrics.path]}, files.out / "plots" / "learning_curve.png")
    if video is not None:
        try:
            log.info("video: %s", video.record(algorithm, env, seed, files.out / "videos"))
        except RenderError as error:
            log.warning("no video: %s", error)
    if evaluation is not None:
        with Progress(1, "evaluation") as progress:
            evaluate_grid(
                algorithm,
                evaluation,
                seed,
                files.out,
                name=f"seed {seed}",
                progress=progress.report,
            )  # type: ignore[arg-type]
