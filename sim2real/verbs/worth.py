"""The verb `worth`: what each cause of a gap costs a policy.

The policy plays the same episodes on robots with every subset of the causes (of more than five: on
drawn ones).
"""

import logging
from collections.abc import Callable
from pathlib import Path

from sim2real.deployment.trained import load_trained
from sim2real.evaluation.cause_costs import CauseCosts, compute_cause_costs, read_causes
from sim2real.evaluation.worth_open import interval_endpoints
from sim2real.evaluation.worth_report import read_diagnosis, shares_closed, write
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.progress import Progress

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    effects: str | None,
    diagnosis: str | None,
    rollouts: int,
    seed: int,
    out: Path,
) -> CauseCosts:
    """Price the causes of a gap.

    Args:
        parts: what trained the policy; like the algorithm, a checkpoint's own.
        algorithm: makes the algorithm from its parts.
        checkpoint: a checkpoint, or a run's folder.
        effects: an effects.yaml or distribution.yaml with the causes.
        diagnosis: report.json of the diagnosis that found them, or a compare.json, or the folder of
            one: which share of the gap each cause closes, and what the logs do not exclude, which
            is played at the ends of its interval. None prices the causes alone.
        rollouts: episodes on each robot.
        seed: of starts, noise, values and orders.
        out: the run's folder; gets worth.json, table.md, table.csv and plots/worth.png.

    Returns:
        What each cause costs.

    Raises:
        Sim2RealError: no causes, a checkpoint that is damaged, a world without a robot.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
    """
    if effects is None:
        raise Sim2RealError("worth needs causes; give effects=PATH, such as a diagnosis wrote")
    causes = read_causes(effects)
    facts = {} if diagnosis is None else read_diagnosis(diagnosis)
    trained = load_trained(checkpoint, parts, algorithm)
    more = interval_endpoints(facts, causes) if facts else []
    with Progress(1, "robot") as progress:
        worth = compute_cause_costs(
            trained, causes, rollouts, seed=seed, excluded=more, report=progress.report
        )
    about = {"policy": str(trained.source), "effects": effects, "diagnosis": diagnosis}
    write(worth, Path(out), shares_closed(facts, causes), {**about, "seed": seed})
    for cause, cost in zip(worth.causes, worth.costs["return"], strict=True):
        log_.info("%s costs %.4g [%.4g, %.4g] of the return", cause.label, *cost)
    return worth
