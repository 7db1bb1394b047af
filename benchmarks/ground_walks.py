"""Walks of a robot that hides something, as its logs tell them: encoders and an IMU, no base.

    logs = walks("quad8", [{"effect": "payload", "where": "torso", "value": 0.2}], seed=11)
    logs = walks_elsewhere("quad8", [], seed=11)    # moved by Drake

Gait and drawn offsets to it are open-loop commands; every other episode begins in mid-gait.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from envs.tasks import Hopper2, Quad8, Quad12
from envs.tasks.servo import ServoTask
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.errors import SafetyError
from hardware.log import Log
from hardware.rows import RobotRows
from sim2real.exam.thirdparty.walk import hide, make_walk

SECONDS, EPISODES = 3.0, 6  # of a walk, and how many
BEGUN = 1.0  # s that every other episode lacks at its start
OFFSET = 0.12  # rad, of the drawn offsets to the gait
Entry = dict[str, Any]
Ends = tuple[float, float]


@dataclass(frozen=True)
class Walker:
    """A robot of the sealed cases."""

    task: Callable[..., ServoTask]  # makes it walk
    torso: str = "torso"  # the body that carries a load
    load: str = "payload"  # as which effect: a point mass at its far end, or mass where its own is
    loads: Ends = (0.15, 0.4)  # masses of it [kg], least and largest
    dry: Ends = (0.08, 0.25)  # dry friction [N·m]
    wet: Ends = (0.05, 0.2)  # viscous friction [N·m·s/rad]
    feels: bool = True  # whether its logs hold an IMU


WALKERS = {
    "quad8": Walker(Quad8),
    "quad12": Walker(Quad12),
    "hopper2": Walker(
        Hopper2, "body", "link_mass", (0.02, 0.06), (0.015, 0.04), (0.002, 0.01), False
    ),
}


def walks(name: str, hidden: Sequence[Entry], seed: int, episodes: int = EPISODES) -> list[Log]:
    """Return logs of the walks of an emulated robot of `WALKERS`, one an episode.

    Every other one begins in mid-gait. Offsets and emulator follow from the seed.
    """
    every = walked(name, hidden, seed, episodes)
    return [seen(log, number) for number, log in enumerate(every) if log.time[-1] > 2 * BEGUN]


def walked(name: str, hidden: Sequence[Entry], seed: int, episodes: int) -> list[Log]:
    """Return whole logs of an emulated robot's walks; arguments are those of `walks`.

    A robot that has fallen so that it cannot begin again has fewer.
    """
    robot, rng = load_robot(name), np.random.default_rng(seed)
    world = EmulatedRobot(robot, hidden=make_hidden(list(hidden), robot), seed=seed)
    rows = RobotRows(
        WALKERS[name].task(seconds=SECONDS), ServoBackend(robot, 0.5, world, seed=seed)
    )
    found = []
    for number in range(episodes):
        actor = _offsets(rows.action_size, rng)
        start = np.array([seed * 1000 + number], np.uint64)
        try:
            rows.reset(np.arange(1), np.zeros((1, 0)), start)
        except SafetyError:  # it fell on its legs, and somebody would have to put it up
            break
        steps = 0
        while not rows.over:
            rows.step(None, actor(steps / robot.rate)[None])
            steps += 1
        if rows.log.last is not None:
            found.append(rows.log.last)
    rows.close()
    return found


def _offsets(size: int, rng: np.random.Generator) -> Any:
    """Return offsets to the gait that change smoothly, a function of time."""
    rate, phase = rng.uniform(0.4, 2.0, (3, size)), rng.uniform(0, 2 * np.pi, (3, size))
    weight = OFFSET * rng.normal(size=(3, size)) / np.sqrt(3)

    def actor(moment: float) -> np.ndarray:
        return (weight * np.sin(2 * np.pi * rate * moment + phase)).sum(axis=0)

    return actor


def seen(log: Log, number: int) -> Log:
    """Return what a robot without a tracker logs; every other episode begins in mid-gait."""
    first = int(np.searchsorted(log.time, BEGUN)) if number % 2 else 0
    dropped = ("obs.", "reward", "sensor.position")
    columns = {n: c[first:] for n, c in log.columns.items() if not n.startswith(dropped)}
    shift = columns["time"][0]
    moved = {n: c - shift for n, c in columns.items() if n == "time" or n.startswith("stamp.")}
    return replace(log, columns={**columns, **moved}, path=Path(f"walk{number}.csv"))


def walks_elsewhere(name: str, hidden: Sequence[Entry], seed: int) -> list[Log]:
    """Return logs of the same commands' walks on a robot that Drake moves.

    What is logged, and from when on, is as in `walks`; the servos' firmware, friction and bus are
    those of `sim2real.exam.thirdparty`.
    """
    walk = make_walk(load_robot(name))
    for entry in hidden:
        walk = hide(walk, entry)
    found = []
    for number, log in enumerate(walked(name, [], seed, EPISODES)):
        ctrl = np.column_stack([log.column(f"ctrl.{joint}") for joint in walk.rig.driven])
        made = walk.go(ctrl, log.time - log.time[0], seed + number)
        if made.time[-1] > 2 * BEGUN:
            found.append(seen(made, number))
    return found
