"""The distance of a log from its simulation: the exam's own measure, independent of diagnosis.

    before = apart(log, spec)                       # (M,) rad, joint by joint
    after = apart(log, spec, load_effects("effects.yaml"))

Each joint is compared at the moment when it was read (`stamp.<joint>`), which on a bus is a few
milliseconds before the row's command.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from envs.plant import Fixed, Plant
from envs.replay import replay, switchable
from hardware.log import Log
from sim2real.diagnosis.data.recording import to_recording


def residuals(log: Log, plant: Plant) -> np.ndarray:
    """Return simulated minus measured positions in each row of a plant, (N, T, M) [rad].

    Args:
        log: one episode; its joints must all turn about one axis.
        plant: the simulations, made of a `switchable` spec.
    """
    model, joints, rows = plant.nominal, log.joints, plant.num_rows
    places = [int(model.jnt_qposadr[model.joint(joint).id]) for joint in joints]
    paths = replay(plant, [to_recording(log, model)] * rows, places)
    measured = np.column_stack([log.column(f"qpos.{joint}") for joint in joints])
    return np.array(paths) - measured


def apart(log: Log, spec: mujoco.MjSpec, fixed: Sequence[Fixed] = ()) -> np.ndarray:
    """Return the RMS replay error of each joint, in a model with fixed effects, (M,) [rad]."""
    plant = Plant(switchable(spec), num_rows=1, fixed=fixed)
    return np.sqrt(np.mean(residuals(log, plant)[0] ** 2, axis=0))
