"""A model's own log: what it does under commands that move every joint, as a file."""

from pathlib import Path

import mujoco
import numpy as np

from envs.models import load_spec
from hardware.log import Log

RATE = 50.0  # rows a second
TONES = (0.4, 0.7, 1.1)  # Hz
COUNT = 2 * np.pi / 4096  # rad, or the same number of m


def own_log(path: Path, size: float | np.ndarray, seconds: float = 6.0, seed: int = 0) -> Log:
    """Return what a model does under waves about its keyframe's commands, within their ranges.

    Args:
        path: an MJCF or URDF; its hinges and slides are logged.
        size: amplitude of the commands, in the actuators' units; one, or that of each, (nu,).
        seconds: length of the log.
        seed: of the waves' phases.
    """
    model = load_spec(path).compile()
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    rng, every = np.random.default_rng(seed), round(1 / RATE / model.opt.timestep)
    time = np.arange(round(seconds * RATE)) * every * model.opt.timestep
    phases = rng.uniform(-np.pi, np.pi, (model.nu, len(TONES)))
    waves = np.sin(2 * np.pi * time[:, None, None] * TONES + phases).mean(axis=2)
    middle = np.where(model.actuator_ctrllimited, _inside(model, size, data.ctrl), data.ctrl)
    ctrl = middle + size * (waves - waves[0])
    joints = [j for j in range(model.njnt) if model.jnt_type[j] in (2, 3)]  # slide, hinge
    seen = np.zeros((len(time), len(joints)))
    for row in range(len(time)):
        seen[row] = data.qpos[model.jnt_qposadr[joints]]
        data.ctrl[:] = ctrl[row]
        for _ in range(every):
            mujoco.mj_step(model, data)
    columns = {"episode": np.zeros(len(time)), "time": time}
    columns |= {f"ctrl.{model.actuator(i).name}": ctrl[:, i] for i in range(model.nu)}
    seen = np.round(seen / COUNT) * COUNT
    columns |= {f"qpos.{model.joint(j).name}": seen[:, k] for k, j in enumerate(joints)}
    return Log(columns)


def _inside(model: mujoco.MjModel, size: float | np.ndarray, ctrl: np.ndarray) -> np.ndarray:
    """Return commands (nu,) so far from the ends of their ranges that waves stay inside."""
    low, high = model.actuator_ctrlrange.T
    room = np.minimum(2 * size, (high - low) / 2)  # waves go from -2 to 2 of their first value
    return np.clip(ctrl, low + room, high - room)
