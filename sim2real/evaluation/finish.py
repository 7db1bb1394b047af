"""The end of a training: its learning curve, what the policy is worth, and a film of it.

finish(learner, files, evaluation, video, seed=0)
"""

import logging

from envs.errors import RenderError
from sim2real.evaluation.evaluate import Evaluation, Evaluator
from sim2real.evaluation.videos import Video
from sim2real.learning.algorithms.base import Algorithm
from sim2real.runs import figures as plots
from sim2real.runs.progress import Progress
from sim2real.runs.run_files import RunFiles

log = logging.getLogger(__name__)


def finalize_training(
    algorithm: Algorithm,
    files: RunFiles,
    evaluation: Evaluator | None,
    video: Video | None,
    seed: int,
) -> None:
    """Draw the learning curve, evaluate the policy and film it; all is already saved.

    After an evaluation over a grid the film shows the robot of the median gain and one of a large
    gain, else a robot of the training. Where nothing can be drawn, a warning says why.
    """
    if files.metrics.path.exists():
        plots.learning_curve({"": [files.metrics.path]}, files.out / "plots" / "learning_curve.png")
    robots = None
    if evaluation is not None:
        with Progress(1, "task") as progress:
            scores = evaluation.assess(algorithm, seed, f"seed {seed}", progress.report)
        evaluation.report([scores], seed, files.out)
        if isinstance(evaluation, Evaluation):
            robots = evaluation.robots_to_film(algorithm, scores)
    if video is not None:
        try:
            log.info("video: %s", video.record(algorithm, seed, files.out / "videos", robots))
        except RenderError as error:
            log.warning("no video: %s", error)
