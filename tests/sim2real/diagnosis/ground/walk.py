"""Walks of simulated robots whose true base is known to the tests."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from envs.tasks.servo.base import ASSETS
from hardware.log import Log

RATE = 50.0


class Walk(NamedTuple):
    """A log without the base's pose, and the truth."""

    log: Log
    model: mujoco.MjModel
    qpos: np.ndarray  # (T, nq)
    qvel: np.ndarray  # (T, nv)


def trot(seconds: float = 3.0, push: float = 0.0) -> Walk:
    """Return a trot of quad8 with drawn offsets, pushed for 0.1 s in the middle [N·m]."""
    phase = 2 * np.pi * np.random.default_rng(0).random(8)
    lift = np.repeat([0.0, np.pi, np.pi, 0.0], 2)

    def goals(t: float) -> np.ndarray:
        stride = 0.15 * np.sin(4 * np.pi * t + lift + np.tile([0.0, np.pi / 2], 4))
        return np.tile([0.6, -1.2], 4) + stride + 0.05 * np.sin(5.0 * t + phase)

    return _walked("quad8.xml", goals, seconds, None, push=push)


def sway(size: float = 0.08) -> Walk:
    """Return quad8 standing, its legs moving slowly [rad], each in its own way."""
    phase = 2 * np.pi * np.random.default_rng(1).random(8)

    def goals(t: float) -> np.ndarray:
        return np.tile([0.6, -1.2], 4) + size * np.sin(3.0 * t + phase)

    return _walked("quad8.xml", goals, 3.0, None)


def stretch(friction: float) -> Walk:
    """Return quad8 standing, its front legs drawn against its back legs."""

    def goals(t: float) -> np.ndarray:
        apart = 0.3 * np.sin(4 * np.pi * t) * np.array([1, 0, 1, 0, -1, 0, -1, 0])
        return np.tile([0.6, -1.2], 4) + apart

    return _walked("quad8.xml", goals, 2.0, friction)


def hops(seconds: float = 3.0) -> Walk:
    """Return hops of hopper2, its boom not logged."""

    def goals(t: float) -> np.ndarray:
        push = np.sign(np.sin(5 * np.pi * t))
        return np.array([0.5, -1.0]) + push * np.array([0.4, -0.8])

    return _walked("hopper2.xml", goals, seconds, None, rate=100.0)


def _walked(
    asset: str, goals, seconds: float, friction: float | None, rate: float = RATE, push: float = 0.0
) -> Walk:
    model = mujoco.MjModel.from_xml_path(str(ASSETS / asset))
    if friction is not None:
        model.geom_friction[:, 0] = friction
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    every = round(1 / rate / model.opt.timestep)
    rows, qpos, qvel = [], [], []
    names = [model.actuator(i).name for i in range(model.nu)]
    for k in range(int(seconds * rate)):
        data.ctrl[:] = goals(k / rate)
        data.xfrc_applied[1, 3] = push * (abs(k / rate - seconds / 2) < 0.05)
        mujoco.mj_forward(model, data)
        row = {"episode": 0.0, "time": k / rate}
        row |= {f"ctrl.{n}": c for n, c in zip(names, data.ctrl, strict=True)}
        count = 2 * np.pi / 4096
        row |= {f"qpos.{n}": round(data.joint(n).qpos[0] / count) * count for n in names}
        for sensor, kind, axes in (
            ("orientation", "quat", "wxyz"),
            ("gyro", "gyro", "xyz"),
            ("accelerometer", "accelerometer", "xyz"),
        ):
            if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, sensor) >= 0:
                said = data.sensor(sensor).data
                row |= {f"{kind}.imu.{a}": x for a, x in zip(axes, said, strict=True)}
        rows.append(row)
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
        for _ in range(every):
            mujoco.mj_step(model, data)
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    meta = {"model": str(ASSETS / asset)}
    return Walk(Log(columns, meta, Path("walk.csv")), model, np.array(qpos), np.array(qvel))


def without(log: Log, *kinds: str) -> Log:
    """Return a log without columns of these kinds."""
    columns = {n: c for n, c in log.columns.items() if n.partition(".")[0] not in kinds}
    return Log(columns, log.meta, log.path)
