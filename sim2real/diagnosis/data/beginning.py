"""Logs whose base moves when they begin: a replay must not start it at rest.

    row = first_row(part, model, {"elbow": 0.0015}, settings)       # 0, or `NEAR`

A log without speeds that begins at rest is replayed from its first row on. Where something moves
already, only rows with neighbours on both sides tell how fast: windows begin at the first of them.
Joints with position servos are not asked: a command's first step moves them as suddenly.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.recording import columns_of
from sim2real.diagnosis.data.speeds import NEAR
from sim2real.diagnosis.settings import Windows

NEARER, FARTHER = 1.5, -0.5  # weights that lead two speeds in a row back to where they began


def first_row(
    part: Log, model: mujoco.MjModel, counts: Mapping[str, float], settings: Windows
) -> int:
    """Return the row of an episode at which its first replay starts.

    Args:
        part: the episode.
        model: its model.
        counts: step between two readings of each position [rad or m]; 0 of those left out.
        settings: from which speed on a log begins in motion.
    """
    if len(part) <= 4 * NEAR:
        return 0
    servos = [a for a in range(model.nu) if is_joint_servo(model, a)]
    held = {int(model.actuator_trnid[a, 0]) for a in servos}
    for i in range(model.njnt):
        places, speeds = columns_of(model, i)
        if i in held or all(f"qvel.{name}" in part.columns for name in speeds):
            continue
        for name in places:
            column = part.columns.get(f"qpos.{name}")
            if column is not None and _moves(part.time, column, counts.get(name, 0.0), settings):
                return NEAR
    return 0


def _moves(time: np.ndarray, position: np.ndarray, count: float, settings: Windows) -> bool:
    """Return whether a position changes at the first row already.

    The speeds between the first rows and between the next are led back to the first row: of what
    starts from rest under a steady torque they are as 1 to 3, which leads back to 0, and under a
    growing one to the other side of it.
    """
    row = int(np.searchsorted(time, time[0] + settings.begins_s - ROUNDING)) // 2
    row = min(max(row, NEAR), (len(time) - 1) // 2)
    near = (position[row] - position[0]) / (time[row] - time[0])
    far = (position[2 * row] - position[row]) / (time[2 * row] - time[row])
    usual = float(np.sqrt(np.mean((np.diff(position) / np.diff(time)) ** 2)))
    count = max(count, settings.begins_least)
    least = max(settings.begins_moving * usual, count / (time[row] - time[0]))
    return bool(np.sign(near) * (NEARER * near + FARTHER * far) > least)
