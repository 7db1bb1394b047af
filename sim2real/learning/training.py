"""Training: an algorithm iterates until its budget is spent, and leaves what a resume needs.

    train(parts=parts, algorithm=algorithm, frames=500_000, ..., out=out)

A resumed run computes, to the last bit, what an uninterrupted one would have: it starts from the
newest checkpoint of the run that it continues (or the one that is named), takes over its rows of
metrics.csv up to there, and goes on in its own folder. Wall-clock numbers are in timing.csv, apart,
because they cannot repeat.

Ctrl-C or SIGTERM: the iteration in progress is finished, a checkpoint written, and one line says
how to resume. A second Ctrl-C abandons the iteration. On a full disk the run stops; its checkpoints
up to there are whole.
"""

import logging
import signal
import time
from collections.abc import Callable
from contextlib import closing, nullcontext
from dataclasses import dataclass
from pathlib import Path

from sim2real.learning.algorithms.base import Algorithm, Components, build
from sim2real.learning.interface import write_interface
from sim2real.learning.population.cluster import Cluster
from sim2real.runs.checkpoint import find, restore
from sim2real.runs.errors import RunInterrupted, Sim2RealError
from sim2real.runs.loggers import Loggers
from sim2real.runs.progress import Progress
from sim2real.runs.run_files import SCORE, RunFiles
from sim2real.runs.stopping import GracefulStop

Finish = Callable[[Algorithm, RunFiles], None]
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Budget:
    """When training is over: the first of the limits that is reached.

    Raises:
        Sim2RealError: without a limit, or for one below 0.
    """

    iterations: int | None  # iterations in all, or None
    frames: int | None  # environment steps, or None

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

    def check_not_exhausted(self, algorithm: Algorithm, start: str | Path) -> None:
        """Raise Sim2RealError if a policy that a run starts from has spent the budget already."""
        if self.done(algorithm):
            raise Sim2RealError(
                f"start={start} has {algorithm.iteration} iterations and {algorithm.frames} steps "
                f"already, which count; iterations={self.iterations} and frames={self.frames} "
                f"leave none: give for example iterations={2 * algorithm.iteration} frames=null"
            )

    def progress(self, algorithm: Algorithm) -> Progress:
        """Return the bar of a run that is here."""
        if self.iterations is not None:
            return Progress(self.iterations, "iteration", algorithm.iteration, algorithm.frames)
        assert self.frames is not None
        return Progress(self.frames, "step", algorithm.frames, algorithm.frames)

    def spent(self, algorithm: Algorithm) -> int:
        """Return the iterations, or the frames, that `progress` counts."""
        return algorithm.iteration if self.iterations is not None else algorithm.frames


def run_training_loop(
    algorithm: Algorithm, budget: Budget, files: RunFiles, logger: Loggers
) -> None:
    """Iterate until the budget is spent, keeping the run's files.

    Raises:
        RunInterrupted: after a signal; see the module's text.
    """
    with GracefulStop() as stopping, budget.progress(algorithm) as progress:
        try:
            while not budget.done(algorithm) and not stopping.signal:
                start, steps = time.monotonic(), algorithm.frames
                metrics = algorithm.iterate()
                seconds, steps = time.monotonic() - start, algorithm.frames - steps
                logger.log(files.record(algorithm, metrics, seconds, steps), algorithm.frames)
                progress.update(budget.spent(algorithm), algorithm.frames, metrics.get(SCORE))
            files.save(algorithm)
        except KeyboardInterrupt:
            what = "the iteration in progress was abandoned"
            raise interruption_error(files, what, stopping.signal) from None
    if stopping.signal:
        raise interruption_error(
            files, f"stopped after iteration {algorithm.iteration}", stopping.signal
        )


def interruption_error(files: RunFiles, what: str, number: int) -> RunInterrupted:
    """Return the exception for signal `number`: what was lost, and how to resume."""
    newest = files.store.latest()
    again = f"to continue, run the same command with resume={newest}"
    return RunInterrupted(
        f"{what}; {again if newest else 'there is no checkpoint yet'}", 128 + number
    )


def train(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    logger: Loggers,
    iterations: int | None,
    frames: int | None,
    checkpoint_every: int,
    keep_checkpoints: int,
    resume: str | Path | None,
    cluster: Cluster | None,
    out: Path,
    finish: Finish | None = None,
    check: Callable[[Algorithm], None] | None = None,
    start: str | Path | None = None,
) -> Algorithm:
    """Train a policy in a folder.

    Args:
        parts: what the algorithm is made of.
        algorithm: makes the algorithm from its parts.
        logger: further loggers.
        iterations: iterations in all, those before a resume included; None for no limit.
        frames: environment steps after which no further iteration starts; None for no limit.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay; the best stays too.
        resume: a run folder or a checkpoint to continue; None starts a new run.
        cluster: where a population's episodes run; None for this machine.
        out: the run's folder.
        finish: called with the trained algorithm and its files, such as to evaluate it; None for
            nothing.
        check: called with the untrained algorithm before a file is written, to refuse what could
            not be done in the end; None for nothing.
        start: a run folder or a checkpoint whose policy a new run goes on from, perhaps in another
            world; its iterations and steps count. None starts with a new policy.

    Returns:
        The trained algorithm.

    Raises:
        Sim2RealError: input that cannot work, before any work starts.
        DiskError: when the run's files could not be written.
        RunInterrupted: after a signal.
    """
    budget = Budget(iterations, frames)
    source = None if resume is None else find(resume)
    learner = build(algorithm, parts)
    with closing(learner):
        if parts.adapt.episodes:
            log.info("adaptation during training: %s", parts.adapt)
        if check is not None:
            check(learner)
        if source is None and start is not None:
            restore(find(start), learner, learner.identity, generators=False)
            budget.check_not_exhausted(learner, start)
        files = RunFiles(Path(out), learner.identity, checkpoint_every, keep_checkpoints)
        files.begin(learner, source)
        with files.writing():
            write_interface(files.out, parts.environment)
        with cluster.attached(learner) if cluster else nullcontext():
            with logger.opened(files.out, files.config):
                run_training_loop(learner, budget, files, logger)
            try:
                with files.writing():
                    if finish is not None:
                        finish(learner, files)
            except KeyboardInterrupt:
                what = "training is complete, its evaluation is not"
                raise interruption_error(files, what, signal.SIGINT) from None
    return learner
