"""The verb `evaluate`: a policy on robots that it was never trained on, before and after it adapts.

Each adaptation starts from the trained parameters. Both policies play the same fresh episodes, so
that random starts cancel in the difference.
"""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

from sim2real.evaluation.evaluate import Evaluator, find_runs
from sim2real.learning.algorithms.base import Algorithm, Components, build
from sim2real.runs.checkpoint import check_expected, read_metadata, restore
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.progress import Progress


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    effects: str | None,
    eval: Evaluator | None,
    checkpoint: str | list[str] | None,
    seed: int,
    out: Path,
) -> Any:
    """Evaluate trained policies.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        effects: an effects.yaml that is put into the simulator; None for the model as it is.
        eval: what to evaluate.
        checkpoint: a checkpoint, a run's folder, a folder of runs, or a list of these; several
            become one table.
        seed: the seed of the evaluation, the same for all runs.
        out: the run's folder.

    Returns:
        The scores of all runs.

    Raises:
        Sim2RealError: nothing to evaluate, or a checkpoint that is damaged or does not fit.
    """
    if eval is None:
        raise Sim2RealError("eval=null leaves nothing to evaluate; choose eval=NAME")
    sources = find_runs(checkpoint)
    learner = build(algorithm, parts.with_effects(effects), adapts=False)
    with closing(learner):
        for source in sources.values():
            check_expected(source, read_metadata(source), learner.identity)
        scores = []
        with Progress(1, "task") as progress:
            for number, (name, source) in enumerate(sources.items()):
                restore(source, learner, learner.identity, generators=False)

                def report_all(done: int, total: int, number: int = number) -> None:
                    progress.report(number * total + done, len(sources) * total)

                scores.append(eval.assess(learner, seed, name, report_all))
    return eval.report(scores, seed, Path(out))
