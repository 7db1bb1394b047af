"""The section of a report about the policy in both simulators: tracks of distances and returns.

    view(report)["tables"][0]["rows"]   # [(label, class of colours, estimate)]

Distances of one measure share a scale; the grey zone is the robot's distance from itself.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim2real.diagnosis.report import axes
from sim2real.diagnosis.schema import ClosedLoop, Estimate, Report
from sim2real.diagnosis.settings import TINY

MEASURES = {
    "sliced_wasserstein": "Sliced Wasserstein distance",
    "mmd": "Maximum mean discrepancy",
}
WORDS = {
    "within_floor": "With this policy, the {world} is about as near to the robot as the robot's "
    "episodes are to each other.",
    "nearer": "The corrected simulator is nearer to the robot than the one as given, but not yet "
    "as near as the robot's episodes are to each other.",
    "as_far": "The corrected simulator is not measurably nearer to the robot than the one as "
    "given, once the policy gives the commands.",
    "farther": "The corrected simulator is farther from the robot than the one as given, once "
    "the policy gives the commands: replayed commands do not show what is wrong. Do not train "
    "with these effects before you know why.",
    "apart": "The simulator as given is farther from the robot than the robot's episodes are from "
    "each other.",
}
WORLDS = ("simulator as given", "corrected simulator")
KINDS = ("floor", "before", "after")  # classes of colours


def view(report: Report) -> dict[str, Any] | None:
    """Return what the section shows; None where no policy wrote the logs."""
    loop = report.closed_loop
    if loop is None:
        return None
    tables = [
        _table(MEASURES[one.measure], (one.floor, one.nominal, one.corrected), one.floor.ci[1])
        for one in loop.distances
    ]
    if loop.returns is not None:
        paid = loop.returns
        tables.append(_table("Return of an episode", (paid.robot, paid.nominal, paid.corrected)))
    return {
        "sentence": words(loop),
        "tables": tables,
        "policy": Path(loop.policy).name,
        "loop": loop,
    }


def words(loop: ClosedLoop) -> str:
    """Return the verdict as a sentence."""
    last = WORLDS[loop.distances[0].corrected is not None]
    return WORDS[loop.verdict].format(world=last)


def _table(
    title: str, estimates: Sequence[Estimate | None], floor: float | None = None
) -> dict[str, Any]:
    """Return the rows of a measure on one scale: a distance has a `floor`, a return has none."""
    known = [one for one in estimates if one is not None]
    low, high = min(one.ci[0] for one in known), max(one.ci[1] for one in known)
    room = (axes.SPARE - 1) * max(high - low, TINY)
    scale = axes.Axis(low - room, high + room)
    if floor is not None:
        scale = axes.Axis(0.0, high * axes.SPARE)
    labels = ("robot" if floor is None else "robot, its other half", *WORLDS)
    rows = list(zip(labels, KINDS, known, strict=False))
    return {"title": title, "rows": rows, "scale": scale, "floor": floor}
