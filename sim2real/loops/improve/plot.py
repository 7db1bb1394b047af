"""The rounds of an improvement in one picture: returns on the robot and in each simulator."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sim2real.runs.figures import AFTER, BEFORE, figure
from sim2real.runs.statistics import Interval

SIDE = 0.08  # of a round, that robot and simulator are apart
CAUSES_MAX = 3  # causes that a round's label names


def draw(
    rounds: Sequence[Any], interval: Callable[[Sequence[float]], Interval], path: Path
) -> None:
    """Draw every episode, the means with their intervals, and what was found before each round."""
    kinds = {
        "in the simulator it was trained in": ("simulator", BEFORE, -SIDE),
        "on the robot": ("robot", AFTER, SIDE),
    }
    with figure(path, 1, 1, (3.0 + 1.6 * len(rounds), 4.0)) as (_, axes):
        panel = axes[0, 0]
        for label, (name, colour, side) in kinds.items():
            there = [one for one in rounds if getattr(one, name) is not None]
            for one in there:
                values = getattr(one, name)
                panel.plot([one.number + 2 * side] * len(values), values, ".", color=colour,
                           alpha=0.35, ms=4)  # fmt: skip
            means = [interval(getattr(one, name)) for one in there]
            low = [m.value - m.low for m in means]
            high = [m.high - m.value for m in means]
            places, values = [one.number + side for one in there], [m.value for m in means]
            panel.errorbar(
                places, values, yerr=[low, high], fmt="o-", color=colour, capsize=3, label=label
            )
        panel.set_xticks([one.number for one in rounds], [_label(one) for one in rounds])
        panel.set_xlim(-0.5, len(rounds) - 0.5)
        panel.set_ylabel("return of an episode\n(lines: means, 95 %; dots: episodes)")
        panel.grid(axis="y")
        panel.legend(fontsize=8)


def _label(one: Any) -> str:
    """Return a round's name, and the causes that its simulator was given."""
    if not one.number:
        return "as given"
    names = [cause["label"].replace("_", " ") for cause in one.causes]
    more = [f"and {len(names) - CAUSES_MAX} more"] if len(names) > CAUSES_MAX else []
    return "\n".join([f"round {one.number}", *names[:CAUSES_MAX], *more])
