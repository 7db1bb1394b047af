"""The interface of a policy on a servo robot: what it was trained to see, to do, and to drive.

    block = interface(environment)          # None where the task is not one of a servo robot
    write_interface(run, environment)       # RUN/policy_interface.json, at the start of a training
    read_interface(checkpoint)              # as it was then; a robot's file may have changed

The block has `robot`, `rate`, `observation` (what each number is, in order), `action` (numbers and
range), `units`, and of each servo `model`, `gains` (its registers) and `limits`.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from envs.tasks.base import CommandState
from envs.tasks.servo import ServoTask
from sim2real.learning.environment import EnvironmentFactory
from sim2real.runs.checkpoint import FOLDER
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

FILE = "policy_interface.json"
UNITS = {
    "rate": "1/s",
    "angle": "rad",
    "speed": "rad/s",
    "orientation": "quaternion w x y z",
    "gyro": "rad/s",
    "time": "s",
    "goal": "rad",
    "gains": "register values",
    "limits.position": "rad",
    "limits.step": "rad per control step",
}
Block = dict[str, Any]


def interface(environment: EnvironmentFactory) -> Block | None:
    """Return the interface of policies trained in an environment; None: no servo robot."""
    task = environment.task
    if not isinstance(task, ServoTask):
        return None
    model, machine, context = task.spec().compile(), task.machine, environment.context_spec
    low, high = task.action_range(model)
    return {
        "robot": machine.name,
        "rate": machine.rate,
        "observation": [*observation_names(task), *([] if context is None else context.names)],
        "action": {"low": np.asarray(low).tolist(), "high": np.asarray(high).tolist()},
        "units": UNITS,
        "servos": {
            model.actuator(i).name: {
                "model": machine.kinds[i],
                "gains": dict(machine.registers[i]),
                "limits": {
                    "position": [float(machine.low[i]), float(machine.high[i])],
                    "step": float(machine.most_step[i]),
                },
            }
            for i in range(model.nu)
        },
    }


def write_interface(run: Path, environment: EnvironmentFactory) -> Path | None:
    """Write the interface into a run's folder, if its task is one of a servo robot."""
    block = interface(environment)
    if block is None:
        return None
    write_text(run / FILE, json.dumps(block, indent=1, ensure_ascii=False) + "\n")
    return run / FILE


def interface_file(checkpoint: Path) -> Path:
    """Return where the interface of a checkpoint's policy is: in its run's folder."""
    folder = checkpoint.resolve().parent
    return (folder.parent if folder.name == FOLDER else folder) / FILE


def read_interface(checkpoint: Path) -> Block:
    """Return the interface that was written when a policy was trained.

    Raises:
        Sim2RealError: there is none, with the command that adds it, or it cannot be read.
    """
    file = interface_file(checkpoint)
    if not file.is_file():
        raise Sim2RealError(
            f"{checkpoint}: nothing says which interface this policy was trained for ({FILE} is "
            f"missing); `python -m sim2real run=export checkpoint={checkpoint}` adds it from "
            "today's task and robot's file: look whether they are those of its training"
        )
    try:
        return dict(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise Sim2RealError(f"{file}: this is not a policy's interface ({error})") from None


def observation_names(task: ServoTask) -> list[str]:
    """Say what each number of an observation is: the measurements that it changes with.

    Found by changing one measurement after the other, so it cannot say anything else than what the
    task does.
    """
    model = task.spec().compile()
    servos = [model.actuator(i).name for i in range(model.nu)]
    rest = np.asarray(task.rest(model))[None]
    size = len(task.action_range(model)[0])
    turn = np.array([[0.96, 0.16, 0.2, 0.1]])

    def see(
        angle: np.ndarray, speed: np.ndarray, time: float, action: np.ndarray, **body: np.ndarray
    ) -> np.ndarray:
        command = CommandState(np.array([time]), action, rest)
        return task.observe(task.state_from_measurement(angle, speed, command, **body))[0]

    zero, idle = np.zeros_like(rest), np.zeros((1, size))
    changes: dict[str, np.ndarray] = {}
    for i, servo in enumerate(servos):
        one = np.eye(len(servos))[i : i + 1] * 0.1
        changes[f"angle.{servo}"] = see(rest + one, zero, 0.0, idle)
        changes[f"speed.{servo}"] = see(rest, zero + one, 0.0, idle)
    for i in range(size):
        changes[f"action.{i}"] = see(rest, zero, 0.0, np.eye(size)[i : i + 1] * 0.1)
    turned = turn / np.linalg.norm(turn)
    changes["orientation"] = see(rest, zero, 0.0, idle, orientation=turned)
    changes["gyro"] = see(rest, zero, 0.0, idle, gyro=np.full((1, 3), 0.1))
    changes["time"] = see(rest, zero, 0.0371, idle)
    plain = see(rest, zero, 0.0, idle)
    moved = {name: seen != plain for name, seen in changes.items()}
    found = ["+".join(name for name in moved if moved[name][k]) for k in range(len(plain))]
    return [name or "constant" for name in found]
