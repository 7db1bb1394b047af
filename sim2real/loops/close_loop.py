r"""From a robot's episodes to the simulator that its policy should train in.

    python -m sim2real +experiment=hopper_gap
    python -m sim2real run=close_loop checkpoint=outputs/train/ppo_source/2026-11-21_10-00-00 \
        +env@target=hopper_polito target.task.domain=target target.task.masses=legacy

`target` stands for the robot: a task whose state is all known. A few of its episodes are recorded,
of a trained policy or of random actions, and `env`, the simulator that the policy knows, is
diagnosed against them. What was found is in effects.yaml, with which training continues:

    python -m sim2real +experiment=ppo_source effects=outputs/close_loop/.../effects.yaml eval=none

With a checkpoint the policy is also played in both simulators and on the target, so that the
returns show how much of the gap is closed for it before anything is trained again.
"""

from __future__ import annotations

import logging
from itertools import pairwise
from pathlib import Path

import numpy as np

from envs.simulation import Simulation
from hardware.log import Log
from sim2real.learning.environment import Environment
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.population.recording import Act
from sim2real.learning.trained import Trained
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import bootstrap, iqm
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
PIECE = 0.25  # s between restarts from a recorded state: longer ones diverge by themselves
PLAYED = 50  # episodes that score a policy in each world
EFFECTS = "effects.yaml"
RECORDING, PLAYING, INTERVALS = 1, 2, 3  # streams of randomness that follow from one seed


def cut(log: Log, seconds: float) -> Log:
    """Return the log in episodes of about so many seconds, each of which starts at its own state.

    A simulation of a robot that nothing holds, such as a hopper in flight, leaves the recording
    soon whatever the model; restarted often, what it makes of the model's errors stays measurable.
    """
    parts = []
    for part in log.episodes():
        pieces = max(1, round(float(np.ptp(part.time)) / seconds))
        edges = np.linspace(0, len(part) - 1, pieces + 1).astype(int)
        parts += [(part, a, b + 1) for a, b in pairwise(edges)]
    columns = {
        name: np.concatenate([part.columns[name][a:b] for part, a, b in parts])
        for name in log.columns
    }
    columns["time"] = np.concatenate([p.time[a:b] - p.time[a] for p, a, b in parts])
    columns["episode"] = np.repeat(np.arange(len(parts)), [b - a for _, a, b in parts])
    return Log(columns, log.meta, log.path)


def noise(robot: Simulation, rng: np.random.Generator) -> Act:
    """Return actions drawn evenly between their limits."""
    low, high = robot.action_low, robot.action_high
    return lambda observation: rng.uniform(low, high, (len(observation), len(low)))


def compare(trained: Trained, target: Environment, out: Path, seed: int) -> Table:
    """Play a policy in the simulator as given, in the corrected one and on the target.

    Returns:
        The interquartile means of the returns with 95 % intervals; also written as returns.md and
        returns.csv.
    """
    given = trained.environment.over(trained.environment.base)
    worlds = {
        "simulator as given": given,
        "with what was found": given.with_effects(out / EFFECTS),
        "target": target,
    }
    table = Table(("world", "return"))
    luck = draw_seeds(np.random.default_rng([seed, PLAYING]), PLAYED)
    for name, world in worlds.items():
        returns = trained.play(luck, world).returns
        rng = np.random.default_rng([seed, INTERVALS])
        table.add(name, bootstrap(returns[:, None], iqm, rng, draws=2000, resample="rows"))
    table.notes.append(f"Interquartile means of {PLAYED} episodes with 95 % intervals.")
    table.write(out / "returns", "The policy's return in each world")
    return table


def one_simulation(made: Environment, key: str, rows: int = 1) -> Simulation:
    """Make the simulation of a configuration's key; raises Sim2RealError for another world."""
    if not made.simulated:
        raise Sim2RealError(
            f"{key} is a {made.name}, which has no robot to diagnose; "
            f"choose a simulated one, such as {key}=hopper_polito"
        )
    return made.base_rows(rows)
