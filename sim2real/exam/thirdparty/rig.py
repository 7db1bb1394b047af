"""A robot in another engine: bodies, servos, gears, friction and a bus, and the log that it writes.

    rig = make_rig(ROBOTS["arm3"])
    log = rig.drive(ctrl, seed=3)                   # ctrl (T, n): rad, or N·m

With nothing changed this is the robot that the model describes, in another engine and with a
firmware, quantization and timing that the model does not have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from hardware.log import Log
from sim2real.exam.thirdparty.bus import Bus
from sim2real.exam.thirdparty.engines import EngineName, make_engine
from sim2real.exam.thirdparty.friction import Bristles, Friction
from sim2real.exam.thirdparty.gear import Gear
from sim2real.exam.thirdparty.servo import Firmware, Motor, Servo
from sim2real.exam.thirdparty.tree import Tree

SETTLE = 1.0  # s that a robot holds its first command before its log begins
HOST = 0.0002  # s: half the spread of the program's own clock
Side = Literal["motor", "link"]
Pull = Callable[[float, float, float], float]  # time [s], angle [rad], speed [rad/s] -> N·m


@dataclass(frozen=True)
class Joint:
    """One joint with what drives it."""

    servo: Servo | None  # its firmware and motor; None where nothing drives it
    friction: Friction  # what rubs, on the motor's side of the gear
    armature: float  # inertia of the rotor at the joint [kg·m²]
    inertia: float  # of everything at the joint [kg·m²], which bristles are damped for
    gear: Gear | None = None  # spring and play between motor and link; None is rigid
    servo_reads: Side = "motor"  # side of the gear that the firmware's encoder is on
    log_reads: Side = "motor"  # side of the gear that the log's encoder is on
    offset: float = 0.0  # added to what both encoders show [rad]
    eccentric: float = 0.0  # amplitude by which they err over a turn [rad]
    phase: float = 0.0  # where in the turn [rad]
    pulls: tuple[Pull, ...] = ()  # further torques on the link


@dataclass(frozen=True)
class Rig:
    """A robot that can be driven."""

    tree: Tree  # its bodies
    joints: Mapping[str, Joint]  # by name, in the order of `tree.names`
    bus: Bus  # between program and servos
    rate: float  # control steps a second
    firmware: float  # ticks of the servos' loops a second
    engine: EngineName  # what moves the bodies
    step: float  # of time [s]
    # the pose about which it moves [rad], by joint
    home: Mapping[str, float] = field(default_factory=dict)
    # where links without children end, in their frames [m], (3,) each
    ends: Mapping[str, np.ndarray] = field(default_factory=dict)
    meta: Mapping[str, Any] = field(default_factory=dict)  # of its logs

    @property
    def driven(self) -> tuple[str, ...]:
        """The joints with a servo."""
        return tuple(name for name, joint in self.joints.items() if joint.servo)

    def change(self, joint: str, **numbers: Any) -> Rig:
        """Return the robot with other numbers of one joint."""
        return replace(self, joints={**self.joints, joint: replace(self.joints[joint], **numbers)})

    def servo(self, joint: str, **numbers: Any) -> Rig:
        """Return the robot with other numbers of one servo."""
        servo = self.joints[joint].servo
        assert servo is not None
        return self.change(joint, servo=replace(servo, **numbers))

    def friction(self, joint: str, **numbers: Any) -> Rig:
        """Return the robot with other friction in one joint."""
        return self.change(joint, friction=replace(self.joints[joint].friction, **numbers))

    def drive(self, ctrl: np.ndarray, seed: int) -> Log:
        """Return the log of one motion.

        Args:
            ctrl: commands, (T, n), in the order of `driven` [rad, or N·m].
            seed: of the timing.
        """
        rng = np.random.default_rng(seed)
        stamps = np.arange(len(ctrl)) / self.rate
        stamps[1:] += HOST * rng.uniform(-1, 1, len(ctrl) - 1)
        times, path = self._run(ctrl, self.bus.arrivals(stamps, rng), stamps[-1])
        seen = self.bus.read(stamps, times, path, rng)
        columns: dict[str, np.ndarray] = {"episode": np.zeros(len(ctrl)), "time": stamps}
        columns |= {f"ctrl.{name}": ctrl[:, i] for i, name in enumerate(self.driven)}
        columns |= {f"qpos.{name}": seen[:, i] for i, name in enumerate(self.driven)}
        return Log(columns, dict(self.meta))

    def _run(
        self, ctrl: np.ndarray, arrivals: np.ndarray, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps' times [s], (S,), and what the log's encoders show then, (S, n)."""
        names = self.tree.names
        armature = {n: 0.0 if j.gear else j.armature for n, j in self.joints.items()}
        engine = make_engine(self.engine, self.tree, armature, self.step)
        start = dict(zip(self.driven, ctrl[0], strict=True))
        torques = any(joint.servo and joint.servo.torque for joint in self.joints.values())
        q = np.array([0.0 if torques else start.get(name, 0.0) for name in names])
        v = np.zeros_like(q)
        engine.place(q, v)
        moving = [
            Moving(self.joints[name], self, angle, start.get(name, 0.0))
            for name, angle in zip(names, q, strict=True)
        ]
        shown = [i for i, name in enumerate(names) if self.joints[name].servo]
        every = max(round(1 / self.firmware / self.step), 1)
        times = np.arange(-round(SETTLE / self.step), round(end / self.step) + 2) * self.step
        rows = np.maximum(np.searchsorted(arrivals, times, side="right") - 1, 0)
        driven = np.zeros((len(ctrl), len(names)))  # of a joint that nothing drives: 0, never read
        driven[:, shown] = ctrl
        commands, path = driven.tolist(), np.empty((len(times), len(shown)))
        for k, (time, row) in enumerate(zip(times.tolist(), rows.tolist(), strict=True)):
            states = list(zip(moving, commands[row], q.tolist(), v.tolist(), strict=True))
            path[k] = [states[i][0].shown(states[i][2]) for i in shown]
            tick = k % every == 0
            torque = [
                one.step(time, goal, tick, angle, speed) for one, goal, angle, speed in states
            ]
            q, v = engine.step(np.array(torque))
        return times, path


class Moving:
    """One joint while it moves: its firmware, motor, bristles and rotor."""

    def __init__(self, joint: Joint, rig: Rig, angle: float, goal: float) -> None:
        self._joint, self._step = joint, rig.step
        servo = joint.servo
        period = max(round(1 / rig.firmware / rig.step), 1) * rig.step
        self._firmware = Firmware(servo, period, goal) if servo else None
        self._motor = Motor(servo, rig.step) if servo else None
        self._bristles = Bristles(joint.friction, joint.inertia, rig.step)
        rub = joint.gear.rub if joint.gear else 0.0
        self._web = Bristles(Friction(rub), joint.armature, rig.step) if rub else None
        self._angle, self._speed, self._demand = angle, 0.0, 0.0

    def shown(self, angle: float) -> float:
        """Return the reading of the log's encoder while the link is at this angle [rad]."""
        own = self._joint.gear is not None and self._joint.log_reads == "motor"
        return self._encoded(self._angle if own else angle)

    def _encoded(self, angle: float) -> float:
        joint = self._joint
        return angle + joint.offset + joint.eccentric * math.sin(angle + joint.phase)

    def step(self, time: float, goal: float, tick: bool, angle: float, speed: float) -> float:
        """Return the torque on the link [N·m], and move motor and friction on by one step."""
        joint, step = self._joint, self._step
        if joint.gear is None:
            self._angle, self._speed = angle, speed
        driven = 0.0
        if self._firmware and self._motor:
            if tick:
                seen = self._encoded(self._angle if joint.servo_reads == "motor" else angle)
                self._demand = self._firmware.tick(goal, seen)
            driven = self._motor(self._demand, self._speed)
        left = driven - self._bristles(self._speed, self._angle, driven)
        if joint.gear is not None:
            twist, rate = self._angle - angle, self._speed - speed
            passed = joint.gear(twist, rate) + (self._web(rate, twist, 0.0) if self._web else 0.0)
            self._speed += step * (left - passed) / joint.armature
            self._angle += step * self._speed
            left = passed
        return left + sum(pull(time, angle, speed) for pull in joint.pulls)
