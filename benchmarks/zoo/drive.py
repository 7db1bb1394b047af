"""A short log of a model, with dry friction hidden in one joint.

    hidden = drive(path, folder / "log.csv", rng)       # MuJoCo at a fourth of the model's step
    hidden.joint, hidden.friction

Actuators follow sums of three sines within their ranges. The joint is drawn among those that are
driven, else among all hinges and slides; its friction is a share of the torque that moves it.
"""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from envs.models import load_spec
from hardware.log import Log, write_log
from sim2real.diagnosis.data.recording import columns_of

RATE, SECONDS = 100, 8.0  # rows a second; s
FINER = 4  # physics steps in one of the model's
COUNT = 1e-4  # rad or m between two readings
REACH, EFFORT = 0.5, 0.6  # rad of a servo, N·m of a motor, where no range is given
USED = 0.5  # of the half range, by the sum of sines
SHARE = 0.4  # friction over the torque that moves the joint, both of the model without it
LEAST = 1e-3  # N·m or N
HINGE = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


class Hidden(NamedTuple):
    """What a log hides, and names that mean its place."""

    joint: str
    friction: float  # N·m or N
    places: tuple[str, ...]  # the joint, its body, its actuators


def drive(path: Path, log: Path, rng: np.random.Generator) -> Hidden:
    """Write a log of a model that hides friction."""
    model = load_spec(path).compile()
    model.opt.timestep /= FINER
    ctrl = _commands(model, rng)
    joint = int(rng.choice(_candidates(model)))
    dof = int(model.jnt_dofadr[joint])
    _, torque = _run(model, ctrl)
    friction = max(SHARE * float(np.sqrt(np.mean(torque[:, dof] ** 2))), LEAST)
    model.dof_frictionloss[dof] += friction
    states, _ = _run(model, ctrl)
    columns = {"episode": np.zeros(len(ctrl)), "time": np.arange(len(ctrl)) / RATE}
    columns |= {f"ctrl.{model.actuator(i).name}": ctrl[:, i] for i in range(model.nu)}
    for i in range(model.njnt):
        names, start = columns_of(model, i)[0], int(model.jnt_qposadr[i])
        read = states[:, start : start + len(names)]
        if int(model.jnt_type[i]) in HINGE:
            read = np.round(read / COUNT) * COUNT
        columns |= {f"qpos.{name}": read[:, k] for k, name in enumerate(names)}
    write_log(log, Log(columns))
    own = model.joint(joint).name
    moved = [
        model.actuator(i).name for i in _actuators(model) if model.actuator_trnid[i, 0] == joint
    ]
    body = model.body(int(model.jnt_bodyid[joint])).name
    return Hidden(own, friction, (own, body, *moved))


def _actuators(model: mujoco.MjModel) -> list[int]:
    """Return the actuators that drive a joint."""
    kind = mujoco.mjtTrn.mjTRN_JOINT
    return [i for i in range(model.nu) if model.actuator_trntype[i] == kind]


def _candidates(model: mujoco.MjModel) -> list[int]:
    """Return the joints that friction may be hidden in."""
    scalar = [i for i in range(model.njnt) if int(model.jnt_type[i]) in HINGE]
    driven = {int(model.actuator_trnid[i, 0]) for i in _actuators(model)}
    return [i for i in scalar if i in driven] or scalar


def _commands(model: mujoco.MjModel, rng: np.random.Generator) -> np.ndarray:
    """Return sums of three sines, (T, nu)."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    usual = [REACH if is_joint_servo(model, i) else EFFORT for i in range(model.nu)]
    given = model.actuator_ctrllimited[:, None] == 1
    low, high = np.where(given, model.actuator_ctrlrange, np.outer(usual, (-1, 1))).T
    usual = np.where(is_wide := (high - low) / 2 > np.array(usual), usual, (high - low) / 2)
    middle = np.where(is_wide & (low < 0) & (high > 0), 0.0, (low + high) / 2)
    tones, phases = rng.uniform(0.2, 1.2, (3, model.nu)), rng.uniform(-3, 3, (3, model.nu))
    waves = np.sin(2 * np.pi * tones * time[:, None, None] + phases).sum(axis=1)
    return np.clip(middle + USED * usual * waves, low, high)


def _run(model: mujoco.MjModel, ctrl: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions before each command, (T, nq), and torques of actuators, (T, nv)."""
    data, steps = mujoco.MjData(model), round(1 / RATE / model.opt.timestep)
    states, torques = np.zeros((len(ctrl), model.nq)), np.zeros((len(ctrl), model.nv))
    for row, command in enumerate(ctrl):
        data.ctrl[:], states[row] = command, data.qpos
        mujoco.mj_step(model, data, steps)
        torques[row] = data.qfrc_actuator + data.qfrc_passive
    return states, torques
