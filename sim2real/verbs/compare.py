"""The verb `compare`: has the robot changed since its last recording?

Exit status: 0 where nothing changed, 3 where something did, 4 where the logs cannot tell.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim2real.diagnosis.comparison.answer import Comparison, Fleet
from sim2real.diagnosis.comparison.compare import compare, compare_fleet
from sim2real.diagnosis.comparison.guard import read_guard
from sim2real.diagnosis.comparison.page import format_change, write_page
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *,
    before: str | list[str] | None,
    after: str | list[str] | None,
    units: list[str],
    ci: str | None,
    model: str | None,
    effects: str | None,
    watch: Sequence[str],
    limits: dict[str, float] | None,
    remounted: bool,
    seed: int,
    out: Path,
) -> Comparison | Fleet:
    """Compare recordings of a robot, or of several.

    Args:
        before: first set of logs: a log, a folder, or a list of these.
        after: second set of logs.
        units: of a fleet, in place of the two: a log or folder for each robot.
        ci: a robot_ci.yaml (docs/how-to/compare_recordings.md), which gives `before` and all others
            but `after`; other arguments take precedence.
        model: an MJCF for all logs; None: the model that each log names.
        effects: an effects.yaml of what the robot had before; None fits what both sides share.
        watch: names of effects that may change; empty for the usual ones.
        limits: by effect, how much of a change passes, in its unit.
        remounted: whether the robot may have been remounted between the recordings.
        seed: of the permutations.
        out: the run's folder; gets compare.json and compare.html.

    Returns:
        The answer; its `exit_status` is that of the process.

    Raises:
        Sim2RealError: no logs to compare, logs of different models, names or limits that are wrong.
    """
    given: dict[str, Any] = {} if ci is None else read_guard(ci)
    said = {"before": before, "model": model, "effects": effects, "limits": limits}
    given |= {name: value for name, value in said.items() if value is not None}
    given |= {"watch": list(watch)} if watch else {}
    remounted = remounted and given.pop("remounted", True)
    first = given.pop("before", None)
    more = {**given, "remounted": remounted, "seed": seed}
    answer: Comparison | Fleet
    if units:
        if first is not None or after is not None:
            raise Sim2RealError("units= replaces before= and after=; remove these")
        named = [Path(path).name for path in units]
        names = named if len(set(named)) == len(named) else units
        answer = compare_fleet(dict(zip(names, units, strict=True)), **more)
    else:
        if first is None or after is None:
            raise Sim2RealError(
                "compare needs two sides; give before=LOGS after=LOGS, ci=robot_ci.yaml after=LOGS "
                "or units=[LOGS,LOGS,LOGS]"
            )
        answer = compare(first, after, **more)
    answer.write(Path(out) / "compare.json")
    write_page(answer, Path(out) / "compare.html")
    for name, one in _each(answer):
        log_.info("%s%s: %s", name, one.verdict.replace("_", " "), one.reason)
        for change in one.changes:
            low, high = change.interval
            log_.warning(
                "%s: %+.4g [%.4g, %.4g] %s",
                format_change(change),
                change.change,
                low,
                high,
                change.unit,
            )
    return answer


def _each(answer: Comparison | Fleet) -> list[tuple[str, Comparison]]:
    if isinstance(answer, Comparison):
        return [("", answer)]
    return [(f"{name}: ", one) for name, one in answer.units.items()]
