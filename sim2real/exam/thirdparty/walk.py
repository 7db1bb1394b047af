"""A walking robot in another engine, and the logs that it writes: encoders and an IMU.

    robot = hide(make_walk(load_robot("quad8")), {"effect": "imu_delay", "value": 0.02})
    log = robot.go(ctrl, stamps, seed=3)

The commands (T, n) are those of a walk; legs, servos and bus are as in `rig`, feet and ground as in
`ground`. Nothing measures where the base is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from hardware.config import Robot
from hardware.log import Log
from sim2real.exam.thirdparty.bus import Bus
from sim2real.exam.thirdparty.ground import Foot, Ground, feet_of, floating
from sim2real.exam.thirdparty.hidden import LAWS, put
from sim2real.exam.thirdparty.rig import Moving, Rig
from sim2real.exam.thirdparty.robots import STEP, joint_of
from sim2real.runs.errors import Sim2RealError

FIRMWARE = 2000.0  # ticks of a servo's loop a second
JITTER = 1e-4  # s: half the spread of the bus
SETTLE = 0.5  # s that a robot stands before it walks
IMU_AGE = 5e-4  # s of an IMU's reading when its row's command is written
WXYZ, AXES = "wxyz", "xyz"


@dataclass(frozen=True)
class Imu:
    """The errors of an IMU."""

    # how it is turned in its site's axes, a rotation vector [rad], (3,)
    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    delay: float = 0.0  # age of its readings beyond the usual one [s]
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of its gyro [rad/s], (3,)


@dataclass(frozen=True)
class Walk:
    """A robot that can walk."""

    rig: Rig  # its bodies, joints and bus; the first body is free
    feet: Sequence[Foot]  # what touches the ground
    height: float  # of the base when it stands [m]
    site: str  # name of its IMU's site, whose axes are the base's
    friction: float  # of its feet on the ground
    imu: Imu = field(default_factory=Imu)  # what its IMU gets wrong

    def go(self, ctrl: np.ndarray, stamps: np.ndarray, seed: int) -> Log:
        """Return the log of one walk.

        Args:
            ctrl: commands, (T, n), in the order of the rig's joints [rad].
            stamps: when they are written, from 0 [s], (T,).
            seed: of the timing.
        """
        rng, bus = np.random.default_rng(seed), self.rig.bus
        times, path, turned, gyro = self._run(ctrl, bus.arrivals(stamps, rng), stamps[-1])
        seen = bus.read(stamps, times, path, rng)
        columns: dict[str, np.ndarray] = {"episode": np.zeros(len(ctrl)), "time": stamps}
        for i, name in enumerate(self.rig.driven):
            columns |= {f"ctrl.{name}": ctrl[:, i], f"qpos.{name}": seen[:, i]}
            columns[f"stamp.{name}"] = stamps - bus.age
        late = np.clip(stamps - IMU_AGE - self.imu.delay, times[0], times[-1])
        askew = Rotation.from_rotvec(self.imu.mounting)
        rows = np.searchsorted(times, late).clip(0, len(times) - 1)
        held = (Rotation.from_quat(turned[rows], scalar_first=True) * askew).as_quat(
            scalar_first=True
        )
        rate = askew.inv().apply(gyro[rows]) + np.array(self.imu.bias)
        columns |= {f"quat.{self.site}.{n}": held[:, i] for i, n in enumerate(WXYZ)}
        columns |= {f"gyro.{self.site}.{n}": rate[:, i] for i, n in enumerate(AXES)}
        return Log(columns, dict(self.rig.meta))

    def _run(
        self, ctrl: np.ndarray, arrivals: np.ndarray, end: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return times [s], (S,), and then angles (S, n), quaternions (S, 4) and gyro (S, 3)."""
        rig, step = self.rig, self.rig.step
        names = rig.tree.names
        armature = {name: rig.joints[name].armature for name in names}
        ground = Ground(rig.tree, self.feet, armature, step, self.friction)
        home = np.array([rig.home[name] for name in names])
        ground.stand(home, self.height)
        q, v = home.copy(), np.zeros_like(home)
        moving = [Moving(rig.joints[n], rig, a, g) for n, a, g in zip(names, q, home, strict=True)]
        every = max(round(1 / rig.firmware / step), 1)
        times = np.arange(-round(SETTLE / step), round(end / step) + 2) * step
        rows = np.searchsorted(arrivals, times, side="right") - 1
        path, turned, gyro = (np.empty((len(times), n)) for n in (len(q), 4, 3))
        for k, (time, row) in enumerate(zip(times.tolist(), rows.tolist(), strict=True)):
            goals = home if row < 0 else ctrl[row]
            _, turned[k], gyro[k] = ground.base()
            path[k] = [one.shown(angle) for one, angle in zip(moving, q, strict=True)]
            torque = [
                one.step(time, goal, k % every == 0, angle, speed)
                for one, goal, angle, speed in zip(
                    moving, goals.tolist(), q.tolist(), v.tolist(), strict=True
                )
            ]
            q, v = ground.step(np.array(torque))
        return times, path, turned, gyro


def make_walk(robot: Robot) -> Walk:
    """Return the robot that a file describes, in another engine.

    Raises:
        Sim2RealError: a robot without a free base, without an IMU, or without feet.
    """
    spec = mujoco.MjSpec.from_file(str(robot.model))
    model, tree = spec.compile(), floating(spec)
    feet = feet_of(model)
    if robot.imu is None or not feet:
        raise Sim2RealError(f"{robot.name}: an IMU and feet that are spheres are needed to walk")
    home, ground = model.key("home").qpos, model.geom(0)
    joints = {name: joint_of(model, name) for name in tree.names}
    counts = robot.servos[0].type.units.counts_per_turn
    bus = Bus(robot.command_delay, robot.reading_age, JITTER, counts)
    angles = {name: float(home[model.joint(name).qposadr[0]]) for name in tree.names}
    meta: Mapping[str, Any] = {
        "robot": robot.name,
        "model": str(robot.model),
        "rate": robot.rate,
        "command_delay": robot.command_delay + 0.5 / FIRMWARE,
    }
    rig = Rig(tree, joints, bus, robot.rate, FIRMWARE, "drake", STEP, angles, {}, meta)
    return Walk(rig, feet, float(home[2]), robot.imu.site, float(ground.friction[0]))


def hide(walk: Walk, entry: Mapping[str, Any]) -> Walk:
    """Return the robot that hides one effect: an entry of an effects.yaml.

    Raises:
        Sim2RealError: an effect that is none of this engine's.
    """
    name, value = entry["effect"], entry["value"]
    own = {"imu_mounting": "mounting", "imu_delay": "delay", "gyro_bias": "bias"}
    if name == "ground_friction":
        return replace(walk, friction=float(value))
    if name in own:
        one = tuple(value) if name != "imu_delay" else float(value)
        return replace(walk, imu=replace(walk.imu, **{own[name]: one}))
    if name not in LAWS:
        raise Sim2RealError(f"{name!r} is not an effect of a robot that walks in another engine")
    if name == "payload":
        return replace(walk, rig=_loaded(walk.rig, entry["where"], value))
    truth = {**entry, "joint": entry["where"], "side": None, "extra": {}}
    return replace(walk, rig=put(walk.rig, truth))


def _loaded(rig: Rig, body: str, mass: float) -> Rig:
    """Return a robot with a point mass [kg] where a body's first child is."""
    links = rig.tree.links
    child = next(one for one in links if one.parent >= 0 and links[one.parent].body == body)
    return replace(rig, tree=rig.tree.load(body, mass, child.position))
