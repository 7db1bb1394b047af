"""A round's checks other than the physics: the policy's interface, and what causes cost it.

interface(logs, load_actor, place)          # "holds", "broken", "cannot_tell" or None
priced(causes, trained, place, 64, seed=0)
facts(place)["causes"]                      # values, intervals, shares and costs
"""

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hardware.log import Log
from sim2real.diagnosis.contract.logged import LoadPolicy, check_logs, has_policy
from sim2real.evaluation import worth_report
from sim2real.evaluation.cause_costs import Cause, compute_cause_costs
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import atomic_folder
from sim2real.runs.progress import Progress

log_ = logging.getLogger(__name__)
DIAGNOSIS, WORTH = "diagnosis", "worth"  # folders of a round


def interface(logs: Sequence[Log], load: LoadPolicy, place: Path) -> str | None:
    """Check what a policy saw and did.

    Args:
        logs: of its episodes; those that hold no policy are left out.
        load: reads the policy that they name.
        place: gets contract.json and contract.html.

    Returns:
        The verdict; None where nothing says it.
    """
    own = [log for log in logs if has_policy(log)]
    if not own:
        return None
    try:
        answer = check_logs(own, load_policy=load)
    except Sim2RealError as error:
        log_.warning("the policy's interface was not checked: %s", error)
        return None
    answer.write(place)
    for finding in answer.findings:
        log_.warning("%s: %s; %s", finding.where, finding.text, finding.fix)
    return answer.verdict


def priced(
    causes: Sequence[Cause], trained: TrainedPolicy, place: Path, rollouts: int, seed: int
) -> None:
    """Say what each cause costs a policy in so many rollouts on each robot, unless worth/ is there.

    The folder of the round holds the diagnosis.
    """
    folder = place / WORTH
    if folder.is_dir():
        return
    with Progress(1, "robot") as progress:
        worth = compute_cause_costs(trained, causes, rollouts, seed=seed, report=progress.report)
    facts = worth_report.read_diagnosis(place / DIAGNOSIS)
    closed = worth_report.shares_closed(facts, causes)
    about = {"policy": str(trained.source), "effects": str(place / DIAGNOSIS), "seed": seed}
    with atomic_folder(folder) as made:
        worth_report.write(worth, made, closed, about)


def facts(place: Path) -> dict[str, Any]:
    """Return the verdict of a round's diagnosis, its gap in a sentence, and causes with costs."""
    report = worth_report.read_diagnosis(place / DIAGNOSIS)
    worth = json.loads((place / WORTH / "worth.json").read_text(encoding="utf-8"))
    causes = [
        {
            "label": f"{one['effect']}.{one['where']}" if one["where"] else one["effect"],
            "value": one["value"] if isinstance(one["value"], float) else one["value"][0],
            "ci": one["ci"],
            "unit": one["unit"],
            "closed": one["closed"],
            "cost": list(one["cost"]["return"].values()),
        }
        for one in worth["causes"]
    ]
    gap = report["gap"]
    left = "" if gap["after"] is None else f", {gap['after']:.3g} with what was found"
    text = (
        f"Diagnosis: {report['verdict'].replace('_', ' ')}; the recordings are {gap['before']:.3g} "
        f"{gap['unit']} off in the simulator as given{left} (noise {gap['noise_floor']:.3g})."
    )
    return {"verdict": report["verdict"], "gap": text, "causes": causes}
