"""What training servo robots and taking them to the bus came to: tables, claims and a picture.

    write({"quad8": {0: {"servo.in_servo": 1.1, "servo.on_bus": 1.1, ...}, 1: ...}}, folder)

Figures that a seed does not have yet are left out; a claim says how many seeds it stands on.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cases import over_runs
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, median
from sim2real.runs.tables import Cell, Table

Seed = Mapping[str, float]
Figures = dict[str, dict[int, dict[str, float]]]  # by robot, seed and name

NAME = "robots"
WORDS = {
    "servo": "ES in `servo`",
    "ideal": "ES in `ideal`",
    "esmaml": "ES-MAML, not adapted",
    "ppo": "PPO in `servo`",
}
FORGIVEN = 0.05  # part of a return; who loses less has nothing to win back


def kept(name: str) -> Callable[[Seed], float]:
    """Return what gives the share of a policy's return in `servo` that it gets on the bus."""
    return lambda seed: seed[f"{name}.on_bus"] / seed[f"{name}.in_servo"]


def lost(seed: Seed) -> float:
    """Return the share of its return in `ideal` that the naive policy loses on the bus."""
    return 1.0 - seed["ideal.on_bus"] / seed["ideal.in_ideal"]


def behind(seed: Seed) -> float:
    """Return by which share the naive policy is behind the other on the bus."""
    return 1.0 - seed["ideal.on_bus"] / seed["servo.on_bus"]


def recovered(shift: str) -> Callable[[Seed], float]:
    """Return what gives the share of a shift's loss that adapting won back; NaN without a loss."""

    def share(seed: Seed) -> float:
        whole, before = seed["esmaml.on_bus"], seed[f"{shift}.before"]
        loss = whole - before
        if loss < FORGIVEN * abs(whole):
            return float("nan")
        return (seed[f"{shift}.after"] - before) / loss

    return share


@dataclass(frozen=True)
class Claim:
    """Something that the median over the seeds must reach."""

    text: str
    # of one seed; a KeyError where figures are missing, NaN where there is nothing to say
    value: Callable[[Seed], float]
    least: float  # the median must reach


CLAIMS = (
    Claim("return on the bus / return in `servo`, ES", kept("servo"), 0.9),
    Claim("return on the bus / return in `servo`, ES-MAML", kept("esmaml"), 0.9),
    Claim("return on the bus / return in `servo`, PPO", kept("ppo"), 0.9),
    Claim("loss of the `ideal` policy on the bus, of its own return", lost, 0.15),
    Claim("the `ideal` policy behind the `servo` one, on the bus", behind, 0.15),
    Claim("load and low voltage: recovered by adapting on the bus", recovered("load"), 0.3),
    Claim("low foot friction: recovered by adapting on the bus", recovered("friction"), 0.3),
)


def values_of(seeds: Mapping[int, Seed], value: Callable[[Seed], float]) -> list[float]:
    """Return a value of every seed that has it."""
    found = []
    for figures in seeds.values():
        try:
            found.append(value(figures))
        except KeyError:
            continue
    return [x for x in found if not np.isnan(x)]


def estimate(values: list[float]) -> Interval | float | None:
    """Return the median with its interval over seeds, as far as there are seeds."""
    return over_runs(values, median)


def claims(found: Figures) -> Table:
    """Return each claim of each robot, with whether it holds."""
    table = Table(("robot", "claim", "median over seeds", "must be", "seeds", "answer"))
    for robot, seeds in found.items():
        for claim in CLAIMS:
            values = values_of(seeds, claim.value)
            if not values:
                continue
            reached = float(np.median(values)) >= claim.least
            answer, must = "holds" if reached else "fails", f">= {claim.least:g}"
            table.add(robot, claim.text, estimate(values), must, len(values), answer)
    return table


def returns(found: Figures) -> Table:
    """Return what each way of training takes and gets."""
    columns = ("robot", "policy", "seeds", "training steps", "CPU minutes")
    table = Table((*columns, "in `ideal`", "in `servo`", "on the bus"))
    for robot, seeds in found.items():
        for name, words in WORDS.items():
            keys = ("steps", "minutes", "in_ideal", "in_servo", "on_bus")
            columns_ = [values_of(seeds, _item(f"{name}.{key}")) for key in keys]
            if not columns_[0]:
                continue
            cost: list[Cell] = [float(np.median(v)) if v else None for v in columns_[:2]]
            table.add(robot, words, len(columns_[0]), *cost, *map(estimate, columns_[2:]))
    return table


def adaptations(found: Figures) -> Table:
    """Return what each ES-MAML policy got on the robots that differ, before and after."""
    table = Table(
        ("robot", "shift", "seeds", "episodes", "unshifted", "before", "after", "recovered")
    )
    for robot, seeds in found.items():
        for shift, words in (("load", "load, low voltage"), ("friction", "low friction")):
            parts = ("episodes", "before", "after")
            episodes, before, after = (values_of(seeds, _item(f"{shift}.{p}")) for p in parts)
            if before:
                whole = estimate(values_of(seeds, _item("esmaml.on_bus")))
                share = estimate(values_of(seeds, recovered(shift)))
                spent = int(max(episodes))
                cells = (whole, estimate(before), estimate(after), share)
                table.add(robot, words, len(before), spent, *cells)
    return table


def _item(key: str) -> Callable[[Seed], float]:
    return lambda seed: seed[key]


def listing(found: Figures) -> Table:
    """Return every figure of every robot and seed."""
    table = Table(("robot", "seed", "figure", "value"))
    for robot, seeds in found.items():
        for seed, figures in seeds.items():
            for name, value in figures.items():
                table.add(robot, seed, name, value)
    return table


TRAINED = ("servo model", "ideal motors", "PPO, servo model", "meta-learned")  # by colour
BARS = (  # figure, where it is tried, colour
    ("servo.in_servo", "simu-\nlation", 0),
    ("servo.on_bus", "bus", 0),
    ("ideal.in_ideal", "simu-\nlation", 1),
    ("ideal.on_bus", "bus", 1),
    ("ppo.in_servo", "simu-\nlation", 2),
    ("ppo.on_bus", "bus", 2),
    ("esmaml.on_bus", "bus", 3),
    ("load.before", "bus,\nload", 3),
    ("load.after", "load,\nadapted", 3),
    ("friction.before", "bus,\nslippery", 3),
    ("friction.after", "slippery,\nadapted", 3),
)


def picture(found: Figures, path: Path) -> None:
    """Draw the median and every seed, a panel for each robot."""
    with figure(path, len(found), 1, (8.4, 2.9 * len(found))) as (_, axes):
        for panel, (robot, seeds) in zip(axes[:, 0], found.items(), strict=True):
            told = set()
            for place, (name, _, colour) in enumerate(BARS):
                values = values_of(seeds, _item(name))
                if values:
                    words = None if colour in told else f"trained with: {TRAINED[colour]}"
                    told.add(colour)
                    shade = COLOURS[colour]
                    panel.bar(place, np.median(values), 0.65, color=shade, alpha=0.45, label=words)
                    panel.plot([place] * len(values), values, "o", color=INK, markersize=3)
            panel.set_xticks(range(len(BARS)), [label for _, label, _ in BARS], fontsize=7)
            panel.set_xlim(-0.6, len(BARS) - 0.4)
            panel.set_ylabel("return of an episode\n(bars: median of seeds)")
            panel.set_title(robot)
        axes[0, 0].legend(fontsize=7, ncols=2, loc="lower center", bbox_to_anchor=(0.6, 1.0))


def page(found: Figures) -> str:
    """Return the results as Markdown."""
    parts = [
        "# Servo robots: learning, the bus, and adapting there",
        f"![Returns by robot, training and world]({NAME}.png)",
        "Bars: medians over training seeds; points: seeds. In brackets: 95 % bootstrap intervals "
        "of the median over seeds. A return in simulation is a mean of 64 episodes, on the "
        "emulated bus of 5. CPU minutes are those of all threads, with start and "
        "evaluation; those of ES-MAML come on top of the policy's that it goes on from, whose "
        "steps are counted in.",
        "## Claims",
        claims(found).markdown().strip(),
        "## Returns",
        returns(found).markdown().strip(),
        "## Adapting on the bus",
        "The policy of ES-MAML on emulated robots that differ from the model (`conf/shift/`): what "
        "it gets on the robot as modelled, on the one that differs, and there after adapting. "
        "Recovered is the share of the difference that adapting won back.",
        adaptations(found).markdown().strip(),
        "Made by `python -m benchmarks.robots`.",
    ]
    return "\n\n".join(parts) + "\n"


def write(found: Figures, results: Path) -> None:
    """Write robots.csv, .md and .png into a folder."""
    write_text(results / f"{NAME}.csv", listing(found).csv())
    write_text(results / f"{NAME}.md", page(found))
    picture({robot: seeds for robot, seeds in found.items() if seeds}, results / f"{NAME}.png")
