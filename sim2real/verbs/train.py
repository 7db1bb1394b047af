"""The verb `train`: improve a policy until its budget is spent, then evaluate and show it.

A resumed run computes, to the last bit, what an uninterrupted one would have. Wall-clock numbers
are in timing.csv, apart, because they cannot repeat.
"""

from collections.abc import Callable
from pathlib import Path

from sim2real.evaluation.evaluate import Evaluator
from sim2real.evaluation.finish import finalize_training
from sim2real.evaluation.videos import Video
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.population.cluster import Cluster
from sim2real.learning.training import train
from sim2real.runs.loggers import Loggers
from sim2real.runs.run_files import RunFiles


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    effects: str | None,
    eval: Evaluator | None,
    logger: Loggers,
    seed: int,
    iterations: int | None,
    frames: int | None,
    checkpoint_every: int,
    keep_checkpoints: int,
    start: str | Path | None,
    resume: str | Path | None,
    video: Video | None,
    cluster: Cluster | None,
    out: Path,
) -> Algorithm:
    """Train.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        effects: an effects.yaml that is put into the simulator; None for the model as it is.
        eval: what to evaluate afterwards; None for nothing.
        logger: further loggers.
        seed: all randomness follows from it.
        iterations: iterations in all, those before a resume included; None for no limit.
        frames: environment steps after which no further iteration starts; None for no limit.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay; the best stays too.
        start: a run folder or a checkpoint whose policy a new run goes on from, as one tunes it to
            another robot; what that run was given holds unless something else is said. None starts
            with a new policy.
        resume: a run folder or a checkpoint to continue; None starts a new run.
        video: the film of the trained policy; None for none.
        cluster: where a population's episodes run; None for this machine.
        out: the run's folder.

    Returns:
        The trained algorithm.

    Raises:
        Sim2RealError: input that cannot work, before any work starts.
        DiskError: when the run's files could not be written.
        RunInterrupted: after Ctrl-C or SIGTERM, once the iteration in progress is finished and a
            checkpoint written; a second Ctrl-C abandons the iteration.
    """

    def after(learner: Algorithm, files: RunFiles) -> None:
        finalize_training(learner, files, eval, video, seed)

    return train(
        parts=parts.with_effects(effects),
        algorithm=algorithm,
        logger=logger,
        iterations=iterations,
        frames=frames,
        checkpoint_every=checkpoint_every,
        keep_checkpoints=keep_checkpoints,
        start=start,
        resume=resume,
        cluster=cluster,
        out=out,
        finish=after,
        check=getattr(eval, "check", None),
    )
