"""Small robots of strangers: links, servos with a law of their own, and what a client logs.

    robot = ARM2.change("elbow", zero=0.4)          # the servo's encoder reads 0.4 rad too much
    log = robot.drive(motion(robot, seconds=8.0, rate=50.0, seed=1), rate=50.0)
    Path("model.xml").write_text(ARM2.nominal(), encoding="utf-8")

The servo shares no line with `envs.effects` or `hardware.emulator`: a firmware loop of 1 kHz on the
encoder's counts asks for a torque; the motor gives what its line from stall to no-load speed leaves
and brakes itself by its back-EMF. MuJoCo moves the links at 2 kHz by these torques alone. Nothing
is random but the motion. The nominal model is what a user writes from the data sheet: a position
actuator with gain, force range and damping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from hardware.log import Log

STEP = 0.0005  # s, of the physics
TICK = 2  # steps from one tick of the firmware to the next
COUNT = 2 * np.pi / 4096  # rad, of the encoder
SETTLE = 1.0  # s that the first command is held before the log begins
BEYOND = 1.0  # rad that a joint's stops lie beyond the largest command
REACH = 1.6  # rad, the largest command of a motion


@dataclass(frozen=True)
class Servo:
    """One servo.

    Args:
        kp: torque per error [N·m/rad].
        braking: torque per speed of the back-EMF [N·m·s/rad].
        limit: largest torque of the loop [N·m].
        rotor: inertia of the motor at the joint [kg·m²].
        stall: torque of the motor at rest [N·m].
        no_load: speed at which the motor's torque has fallen to 0 [rad/s].
        zero: added to what the encoder shows [rad].
    """

    kp: float = 8.0
    braking: float = 0.4
    limit: float = 3.0
    rotor: float = 0.01
    stall: float = math.inf
    no_load: float = math.inf
    zero: float = 0.0

    def torque(self, goal: float, seen: float, speed: float) -> float:
        """Return the motor's torque at the joint [N·m]."""
        demand = max(-self.limit, min(self.limit, self.kp * (goal - seen)))
        if math.isfinite(self.stall):
            forward = max(self.stall * (1 - speed / self.no_load), 0.0)
            backward = max(self.stall * (1 + speed / self.no_load), 0.0)
            demand = max(-backward, min(forward, demand))
        return demand - self.braking * speed


@dataclass(frozen=True)
class Link:
    """One link and the joint at its root.

    Args:
        joint: the joint's name.
        axis: its axis in the link's frame.
        length: of the link, which hangs down [m].
        mass: of the link [kg].
        servo: what drives the joint.
    """

    joint: str
    axis: str = "0 1 0"
    length: float = 0.2
    mass: float = 0.25
    servo: Servo = Servo()


@dataclass(frozen=True)
class Robot:
    """A chain of links.

    Args:
        links: from the base.
        compensated: whether the firmware adds the torque that holds the links against gravity.
    """

    links: tuple[Link, ...]
    compensated: bool = False

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints, which their actuators share."""
        return tuple(link.joint for link in self.links)

    def change(self, joint: str, **numbers: float) -> Robot:
        """Return the robot with other numbers of one servo."""
        links = [
            replace(link, servo=replace(link.servo, **numbers)) if link.joint == joint else link
            for link in self.links
        ]
        return replace(self, links=tuple(links))

    def nominal(self) -> str:
        """Return the MJCF that a user has."""
        servos = "".join(
            f'<position name="{link.joint}" joint="{link.joint}" kp="{link.servo.kp}" '
            f'damping="{link.servo.braking}" '
            f'forcerange="{-link.servo.limit} {link.servo.limit}"/>'
            for link in self.links
        )
        return self._mjcf(f"<actuator>{servos}</actuator>", 0.002)

    def drive(self, goals: np.ndarray, rate: float) -> Log:
        """Return the log of a motion.

        Args:
            goals: commands [rad], (T, n), in the order of the joints.
            rate: rows a second.
        """
        model = mujoco.MjModel.from_xml_string(self._mjcf("", STEP, self.compensated))
        data = mujoco.MjData(model)
        servos = [link.servo for link in self.links]
        zeros = np.array([servo.zero for servo in servos])
        time = np.arange(len(goals)) / rate
        ticks = np.round((time + SETTLE) / (TICK * STEP)).astype(int).tolist()
        seen, goal, row = np.zeros_like(goals), goals[0].tolist(), 0
        data.qpos[:] = goals[0] - zeros
        for tick in range(ticks[-1] + 1):
            angles = (np.rint((data.qpos + zeros) / COUNT) * COUNT).tolist()
            if tick == ticks[row]:
                seen[row], goal = angles, goals[row].tolist()
                row += 1
            states = zip(servos, goal, angles, data.qvel.tolist(), strict=True)
            data.qfrc_applied[:] = [servo.torque(*state) for servo, *state in states]
            mujoco.mj_step(model, data, TICK)
        columns = {"episode": np.zeros(len(time)), "time": time}
        columns |= {f"ctrl.{name}": goals[:, i] for i, name in enumerate(self.joints)}
        columns |= {f"qpos.{name}": seen[:, i] for i, name in enumerate(self.joints)}
        return Log(columns)

    def _mjcf(self, actuators: str, timestep: float, compensated: bool = False) -> str:
        end = REACH + BEYOND
        bodies, place = "", "0 0 0"
        for number, link in enumerate(self.links):
            bodies += (
                f'<body name="link{number}" pos="{place}" gravcomp="{int(compensated)}">'
                f'<joint name="{link.joint}" '
                f'axis="{link.axis}" armature="{link.servo.rotor}" limited="true" '
                f'range="{-end} {end}"/><geom type="capsule" fromto="0 0 0 0 0 {-link.length}" '
                f'size="0.02" mass="{link.mass}"/>'
            )
            place = f"0 0 {-link.length}"
        return (
            f'<mujoco><compiler angle="radian"/><option timestep="{timestep}" '
            'integrator="implicitfast"><flag contact="disable"/></option><worldbody>'
            f"{bodies}{'</body>' * len(self.links)}</worldbody>{actuators}</mujoco>"
        )


def motion(robot: Robot, seconds: float, rate: float, seed: int, size: float = 1.0) -> np.ndarray:
    """Return commands (T, n) [rad]: three sines a joint, then steps of half a second, in turns."""
    rng, count = np.random.default_rng(seed), len(robot.joints)
    time = np.arange(round(seconds * rate)) / rate
    tones = rng.uniform((0.2, 0.5, 1.0), (0.4, 0.9, 1.6), (count, 3))
    phases = rng.uniform(-np.pi, np.pi, (count, 3))
    waves = np.sin(2 * np.pi * time[:, None, None] * tones + phases) @ (0.5, 0.3, 0.12)
    held = rng.uniform(-0.8, 0.8, (math.ceil(2 * seconds), count))
    steps = held[np.minimum((2 * time).astype(int), len(held) - 1)]
    goals = np.where((time % 4 < 2.5)[:, None], waves, steps)
    return np.clip(size * goals, -REACH, REACH)


ARM1 = Robot((Link("hinge", servo=Servo(kp=6.0, braking=0.3)),))
ARM2 = Robot(
    (
        Link("shoulder", mass=0.3),
        Link("elbow", mass=0.2, servo=Servo(kp=6.0, braking=0.3)),
    )
)
ARM3 = Robot(
    (
        Link("yaw", axis="0 0 1", length=0.1),
        Link("lift", mass=0.3),
        Link("bend", mass=0.2, servo=Servo(kp=6.0, braking=0.3)),
    )
)
