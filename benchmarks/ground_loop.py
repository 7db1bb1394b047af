"""Does a corrected simulator show what a policy meets on a robot, and what it is paid there?

    python -m benchmarks.ground_loop            # the true effects in the simulator, a row each

A policy of linear feedback walks on an emulated robot (servo emulator, bus, another time step) that
hides an effect, and in its simulator as given and corrected. `benchmarks.ground` does the same with
what its sealed cases found.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from tensordict.nn import TensorDictModule

from envs.effects import make
from envs.mujoco import MujocoEnv
from envs.tasks import Quad8
from envs.tasks.servo import ServoTask
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.log import Log
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.robot_env import on_robot, play, robot_of
from sim2real.diagnosis.closed_loop.check import Drawn, check_closed_loop
from sim2real.diagnosis.schema import ClosedLoop, Estimate
from sim2real.diagnosis.settings import DEFAULT
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.loops.player import PolicySimulator

Entry = dict[str, Any]
EPISODES = 6  # on the robot
GAIN, GAIN_SEED = 0.3, 1  # of the feedback, and what its directions are drawn from
SURE = 0.05  # half an interval about a true value, of the value
HIDDEN: list[list[Entry]] = [
    [],
    [{"effect": "ground_friction", "where": None, "value": 0.25}],
    [{"effect": "motor_strength", "where": "knee_br", "value": 0.6}],
    [{"effect": "payload", "where": "torso", "value": 0.3}],
    [{"effect": "command_delay", "where": None, "value": 0.02}],
    [{"effect": "coulomb_friction", "where": "knee_fl", "value": 0.15}],
]


def feedback(task: ServoTask) -> TrainedPolicy:
    """Return a policy whose actions are a fixed linear function of what it sees."""
    environment = EnvironmentFactory(partial(MujocoEnv, task, dtype=torch.float64))
    size, low, _ = environment.observation_and_action_spec()
    gains = GAIN / np.sqrt(size) * np.random.default_rng(GAIN_SEED).normal(size=(size, len(low)))

    def act(observation: torch.Tensor) -> torch.Tensor:
        return observation.double() @ torch.from_numpy(gains)

    module = TensorDictModule(act, ["observation"], ["action"])
    none = np.zeros(0, np.float32)
    return TrainedPolicy(none, lambda theta: module, environment, {}, 0, dtype=torch.float64)


def deployed(robot: str, trained: TrainedPolicy, hidden: Sequence[Entry], seed: int) -> list[Log]:
    """Return the logs of a policy's episodes on an emulated robot that hides effects."""
    machine, task = load_robot(robot), servo_task(trained.environment)
    world = EmulatedRobot(machine, hidden=make_hidden(list(hidden), machine), seed=seed)
    env = on_robot(trained, task, ServoBackend(machine, 0.5, world, seed=seed))
    actor, log, found = trained.acting(env), robot_of(env).log, []
    for number in range(EPISODES):
        play(env, actor, seed + number)
        if log.last is not None:
            found.append(log.last)
    env.close()
    return found


def loop(
    robot: str, task: ServoTask, hidden: Sequence[Entry], effects: Sequence[Drawn], seed: int
) -> ClosedLoop:
    """Return the closed loop of a robot that hides effects, in a simulator with others."""
    trained = feedback(task)
    logs = deployed(robot, trained, hidden, seed)
    return check_closed_loop(logs, PolicySimulator(trained), effects, seed, DEFAULT)


def true_effects(hidden: Sequence[Entry]) -> list[Drawn]:
    """Return what is hidden as if it had been found, to 5 per cent."""
    found = []
    for entry in hidden:
        place = {} if entry["where"] is None else {"where": entry["where"]}
        value = float(entry["value"])
        ends = ((1 - SURE) * value, (1 + SURE) * value)
        found.append(Drawn(make(entry["effect"], **place), (value,), ends))
    return found


def main() -> int:
    """Print a row for each hidden effect."""
    for number, hidden in enumerate(HIDDEN):
        told = loop("quad8", Quad8(), hidden, true_effects(hidden), seed=1000 + number)
        one, paid = told.distances[0], told.returns
        name = hidden[0]["effect"] if hidden else "nothing"
        numbers = [one.floor, one.nominal, one.corrected]
        numbers += [] if paid is None else [paid.robot, paid.nominal, paid.corrected]
        print(name, told.verdict, *map(_text, numbers), sep=" | ", flush=True)
    return 0


def _text(one: Estimate | None) -> str:
    return "" if one is None else f"{one.value:.3g} [{one.ci[0]:.3g}, {one.ci[1]:.3g}]"


if __name__ == "__main__":
    raise SystemExit(main())
