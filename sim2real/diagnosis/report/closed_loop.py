"""The section of a report about the policy in both simulators: tracks of distances and returns.

    view(report)["rows"]                # [{"group", "label", "kind", "picture", "value", "ci"}]

Distances of one measure share a scale; the grey zone is the robot's distance from itself.
"""

from pathlib import Path
from typing import Any

from sim2real.diagnosis.report import axes, svg
from sim2real.diagnosis.schema import ClosedLoop, Distance, Estimate, Report, Returns
from sim2real.diagnosis.settings import TINY

MEASURES = {
    "sliced_wasserstein": "Sliced Wasserstein distance",
    "mmd": "Maximum mean discrepancy",
}
WORDS = {
    "within_floor": "In the {world} the policy's robot measures what the real one measured: "
    "the two are about as near to each other as the robot's episodes among themselves.",
    "nearer": "The corrected simulator is nearer to the robot than the one as given, and not yet "
    "as near as the robot's episodes among themselves.",
    "as_far": "The corrected simulator is not measurably nearer to the robot than the one as "
    "given, once the policy gives the commands.",
    "farther": "The corrected simulator is farther from the robot than the one as given, once "
    "the policy gives the commands: replayed commands do not show what is wrong. Do not train "
    "with these effects before you know why.",
    "apart": "The simulator as given is farther from the robot than the robot's episodes among "
    "themselves.",
}
WORLDS = ("robot, its other half", "simulator as given", "corrected simulator")
KINDS = ("floor", "before", "after")  # classes of colours
NUMBERS = 4  # on a scale, about


def view(report: Report) -> dict[str, Any] | None:
    """Return what the section shows; None where no policy wrote the logs."""
    loop = report.closed_loop
    if loop is None:
        return None
    tables = [_distances(one) for one in loop.distances]
    if loop.returns is not None:
        tables.append(_returns(loop.returns))
    return {
        "sentence": words(loop),
        "tables": tables,
        "policy": Path(loop.policy).name,
        "channels": ", ".join(loop.channels),
        "loop": loop,
    }


def words(loop: ClosedLoop) -> str:
    """Return the verdict as a sentence."""
    last = WORLDS[1 if loop.distances[0].corrected is None else 2]
    return WORDS[loop.verdict].format(world=last)


def _distances(one: Distance) -> dict[str, Any]:
    estimates = [one.floor, one.nominal, one.corrected]
    ends = [end for own in estimates if own is not None for end in own.ci]
    scale = axes.Linear(0.0, max(ends) * axes.SPARE)
    return _table(MEASURES.get(one.measure, one.measure), estimates, scale, one.floor.ci[1])


def _returns(paid: Returns) -> dict[str, Any]:
    estimates = [paid.robot, paid.nominal, paid.corrected]
    ends = [end for own in estimates if own is not None for end in own.ci]
    room = (axes.SPARE - 1) * max(max(ends) - min(ends), TINY)
    scale = axes.Linear(min(ends) - room, max(ends) + room)
    table = _table("Return of an episode", estimates, scale)
    table["rows"][0]["label"] = "robot"
    return table


def _table(
    title: str, estimates: list[Estimate | None], scale: axes.Linear, floor: float | None = None
) -> dict[str, Any]:
    """Return the rows of a measure on one scale; up to `floor` it is shaded."""
    shade = 0.0 if floor is None else float(scale(floor))
    ticks = [(float(scale(value)), text) for value, text in scale.ticks(NUMBERS)]
    rows = []
    for label, kind, one in zip(WORLDS, KINDS, estimates, strict=True):
        if one is None:
            continue
        low, high, at = (float(scale(value)) for value in (*one.ci, one.value))
        places = [place for place, _ in ticks]
        picture = svg.track(low, high, [(at, kind)], floor=shade, ticks=places)
        number = f"{one.value:.3g}".replace("-", "−")
        ci = f"{one.ci[0]:.3g} to {one.ci[1]:.3g}".replace("-", "−")
        rows.append({"label": label, "kind": kind, "picture": picture, "value": number, "ci": ci})
    return {"title": title, "rows": rows, "scale": svg.numbers(ticks)}
