"""What the verb `relearn` is made of: policies, what they return on the robot, and what is closed.

What is closed of the gap is (corrected - nominal) / (truth - nominal), returns on the robot.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from envs.effects import load_effects
from hardware.config import Robot
from hardware.excite import Kind
from hardware.log import read_logs
from hardware.safety import StopLimits
from sim2real.deployment import deploy
from sim2real.loops.improve import steps
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, bootstrap, iqm, mean, share_closed
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
NOMINAL, CORRECTED, TRUTH = "nominal", "corrected", "truth"
WORDS = {NOMINAL: "as given", CORRECTED: "with what was found", TRUTH: "with what is hidden"}
RESULT, EFFECTS = "gap.json", "effects.yaml"
RECORDING, INTERVALS = 1, 2  # streams of randomness that follow from one seed
DRAWS = 2000  # resamples of an interval


@dataclass(frozen=True)
class Tried:
    """What a policy earned, episode by episode: where it was learned, and on the robot."""

    simulator: list[float]
    robot: list[float]


ONE_BY_ONE = (
    "would be deployed, hung up and deployed again at once; run=improve asks before each motion; "
    "or do these steps one by one: run=deploy, run=record on a stand, run=diagnose, training with "
    "effects=, run=deploy"
)


def emulated(robot: dict[str, Any], why: str = ONE_BY_ONE) -> Robot:
    """Return the emulated robot of a configuration.

    Args:
        robot: the content of conf/robot/NAME.yaml.
        why: a robot at a port is refused, and what to do instead; follows its name.

    Raises:
        Sim2RealError: it is at a port.
    """
    machine = deploy.make_machine(robot, None, None)
    if machine.port is not None:
        raise Sim2RealError(f"{machine.name} at {machine.port} {why}")
    return machine


def diagnosed(
    robot: Robot,
    motions: Sequence[Kind],
    seconds: float,
    guard: StopLimits,
    seed: int,
    folder: Path,
) -> Path:
    """Record the robot on a stand, diagnose its nominal model, and return what was found.

    Args:
        robot: the emulated robot.
        motions: kinds of motion.
        seconds: the duration of each recording.
        guard: when it is stopped.
        seed: the seed of motions, noise and the diagnosis.
        folder: gets stand/ and diagnosis/; what is there is not done again.

    Returns:
        The file of effects.
    """
    rng = np.random.default_rng([seed, RECORDING])
    steps.on_stand(robot, folder / "stand", motions, seconds, guard, rng, seed)
    return steps.diagnosed(read_logs(folder / "stand"), None, seed, folder / "diagnosis")


def report(tried: dict[str, Tried], folder: Path, seed: int) -> Table:
    """Write gap.json, table.md, table.csv and plots/gap.png; return the table."""
    table = Table(("learned in the simulator", "return there", "return on the robot", "closed"))
    rng = np.random.default_rng([seed, INTERVALS])
    for name, one in tried.items():
        closed = closing(tried, rng) if name == CORRECTED else None
        table.add(WORDS[name], _estimate(one.simulator, rng), _estimate(one.robot, rng), closed)
    episodes = len(tried[NOMINAL].robot)
    found = load_effects(folder / "diagnosis" / EFFECTS)
    named = ", ".join(f"{effect.label()} {values[0]:.4g}" for effect, values in found)
    table.notes += [
        f"Found: {named or 'nothing'}.",
        f"Means of {episodes} episodes that start alike everywhere, with 95 % bootstrap intervals "
        "over these; one training each. closed = (with what was found - as given) / (with what is "
        "hidden - as given), on the robot.",
    ]
    content = {"seed": seed, "found": named, "policies": {n: asdict(t) for n, t in tried.items()}}
    write_text(folder / RESULT, json.dumps(content, indent=1) + "\n")
    table.write(folder / "table", "The gap before and after the simulator was corrected")
    draw({name: [one] for name, one in tried.items()}, folder / "plots" / "gap.png")
    log_.info("%s", table.markdown())
    return table


def closing(tried: dict[str, Tried], rng: np.random.Generator) -> Interval | None:
    """Return the share of the gap that is closed, over episodes; None where it is not known."""
    if TRUTH not in tried or len(tried[TRUTH].robot) < 2:
        return None
    before, after, best = (
        np.array(tried[name].robot)[:, None] for name in (NOMINAL, CORRECTED, TRUTH)
    )
    return share_closed(before, after, best, mean, rng, draws=DRAWS)


def _estimate(returns: list[float], rng: np.random.Generator) -> Interval | float:
    if len(returns) < 2:
        return returns[0]
    return bootstrap(np.array(returns)[:, None], mean, rng, draws=DRAWS, resample="rows")


def draw(tried: dict[str, list[Tried]], path: Path) -> None:
    """Draw the mean returns in simulation and on the robot, a line for each training run.

    Args:
        tried: the runs, by the simulator that they learned in.
        path: the path of the picture.
    """
    labels = ("in its simulator", "on the emulated robot")
    with figure(path, 1, 1, (6.0, 3.2)) as (_, axes):
        panel = axes[0, 0]
        for place, runs in enumerate(tried.values()):
            at = [place - 0.18, place + 0.18]
            ends = np.array(
                [[np.mean(one.simulator), np.mean(one.robot)] for one in runs]
            )  # (n, 2)
            for pair in ends:
                panel.plot(at, pair, "-", color="#aaaaaa", lw=1)
            for x, values, colour, words in zip(at, ends.T, COLOURS, labels, strict=False):
                panel.plot([x] * len(values), values, "o", color=colour, label=words)
                if len(values) > 1:
                    panel.hlines(float(iqm(values[:, None])), x - 0.1, x + 0.1, color=INK, lw=2)
            labels = (None, None)
        panel.set_xticks(
            range(len(tried)), [f"learned in the simulator\n{WORDS[n]}" for n in tried]
        )
        panel.set_ylabel("return of an episode\n(lines: IQM of runs)")
        panel.grid(axis="y")
        panel.legend(fontsize=8)
