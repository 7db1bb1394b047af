"""A servo and a link about one axis, integrated by scipy: what the engine's effects are held to.

    path = follow(Pendulum(play=0.05, servo="motor"), goals, times)     # motor and link, (T, 2)

Written from the equations alone; nothing of the project's effects or of the engine is used. The
link is a pendulum of inertia I about the axis, the motor a rotor of inertia J behind its gear. The
servo's torque is kp (goal - q) - kd w, of the motor's or the link's angle, its back-EMF always the
motor's. What is between them is a play with rigid, inelastic ends, a spring, or nothing.

* Play: pieces between events. Free: two bodies. In contact: one body, and the force between the
  two follows from the motor's own motion; it ends where that force would have to pull.
* Friction: LuGre, C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, A new model for
  control of systems with friction, IEEE Trans. Automatic Control 40 (3), 1995, equations 1 to 3.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.integrate import solve_ivp

RELATIVE, ABSOLUTE = 1e-8, 1e-10
GRAZE = 1e-9  # of the play: so far inside its ends a piece without contact begins


@dataclass(frozen=True)
class Bristles:
    """LuGre friction."""

    coulomb: float  # N·m
    static: float  # N·m
    speed: float  # rad/s: Stribeck's
    stiffness: float  # N·m/rad: sigma 0
    damping: float  # N·m·s/rad: sigma 1

    def level(self, speed: float) -> float:
        """Return the friction of steady sliding [N·m]."""
        return self.coulomb + (self.static - self.coulomb) * np.exp(-((speed / self.speed) ** 2))


@dataclass(frozen=True)
class Pendulum:
    """The robot; rad, N·m, kg·m²."""

    link: float = 0.003  # inertia about the axis
    rotor: float = 0.002
    weight: float = 0.2  # mass times gravity times distance of the centre [N·m]
    kp: float = 4.0
    kd: float = 0.0  # of the servo's own law
    emf: float = 0.12  # back-EMF, of the motor
    limit: float = 3.0  # N·m
    servo: Literal["motor", "link"] = "motor"  # where its encoder sits
    play: float = 0.0
    softness: float = 0.0  # of the spring, rad/(N·m)
    spring_damping: float = 0.0
    spring_friction: float = 0.0  # dry, smoothed within a mrad/s
    friction: Bristles | None = None  # at the motor

    def torque(self, goal: float, motor: np.ndarray, link: np.ndarray) -> float:
        """Return the motor's torque, of angles and speeds (2,) each."""
        seen = motor if self.servo == "motor" else link
        asked = self.kp * (goal - seen[0]) - self.kd * seen[1]
        return float(np.clip(asked, -self.limit, self.limit)) - self.emf * motor[1]

    def gravity(self, angle: float) -> float:
        """Return the weight's torque on the link."""
        return -self.weight * np.sin(angle)


def follow(robot: Pendulum, goals: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the angles of motor and link at times [s], the goal of each held to the next, (T, 2).

    It starts at rest, hanging, in the middle of the play.
    """
    if robot.play > 0:
        return _with_play(robot, goals, times)
    law = _spring(robot) if robot.softness > 0 else _rigid(robot)
    state = np.zeros(4 if robot.softness > 0 else 3)
    path = [_angles(robot, state)]
    for goal, start, end in zip(goals, times[:-1], times[1:], strict=False):
        state = solve_ivp(
            lambda t, y, goal=goal: law(goal, y),
            (start, end),
            state,
            method="LSODA",
            rtol=RELATIVE,
            atol=ABSOLUTE,
        ).y[:, -1]
        path.append(_angles(robot, state))
    return np.array(path)


def _angles(robot: Pendulum, state: np.ndarray) -> tuple[float, float]:
    return (state[0], state[2]) if robot.softness > 0 else (state[0], state[0])


def _rigid(robot: Pendulum) -> Callable[[float, np.ndarray], list[float]]:
    """Return the motion of angle, speed and bristles where motor and link are one."""

    def law(goal: float, y: np.ndarray) -> list[float]:
        angle, speed, bristle = y
        torque = robot.torque(goal, y[:2], y[:2]) + robot.gravity(angle)
        slip = 0.0
        if robot.friction is not None:
            own = robot.friction
            slip = speed - own.stiffness * abs(speed) / own.level(speed) * bristle
            torque -= own.stiffness * bristle + own.damping * slip
        return [speed, torque / (robot.rotor + robot.link), slip]

    return law


def _spring(robot: Pendulum) -> Callable[[float, np.ndarray], list[float]]:
    """Return the motion of motor and link with a spring between them."""

    def law(goal: float, y: np.ndarray) -> list[float]:
        motor, link = y[:2], y[2:]
        pull = (motor[0] - link[0]) / robot.softness + robot.spring_damping * (motor[1] - link[1])
        pull += robot.spring_friction * np.tanh((motor[1] - link[1]) / 1e-3)
        own = (robot.torque(goal, motor, link) - pull) / robot.rotor
        return [motor[1], own, link[1], (pull + robot.gravity(link[0])) / robot.link]

    return law


def _with_play(robot: Pendulum, goals: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Integrate piece by piece: free, or in contact at an end (side 1: the link leads)."""
    half, state, side = robot.play / 2, np.zeros(4), 0
    path = [(0.0, 0.0)]
    for goal, start, end in zip(goals, times[:-1], times[1:], strict=False):
        now = float(start)
        while now < end:
            if side == 0:
                now, state, side = _free(robot, goal, now, float(end), state, half)
            else:
                now, state, side = _joined(robot, goal, now, float(end), state, side * half)
        path.append((state[0], state[2]))
    return np.array(path)


def _free(
    robot: Pendulum, goal: float, start: float, end: float, state: np.ndarray, half: float
) -> tuple[float, np.ndarray, int]:
    def law(t: float, y: np.ndarray) -> list[float]:
        motor, link = y[:2], y[2:]
        return [
            motor[1],
            robot.torque(goal, motor, link) / robot.rotor,
            link[1],
            robot.gravity(link[0]) / robot.link,
        ]

    ends = []
    for sign in (1, -1):

        def meets(t: float, y: np.ndarray, sign: int = sign) -> float:
            return sign * (y[2] - y[0]) - half

        meets.terminal, meets.direction = True, 1.0  # type: ignore[attr-defined]
        ends.append(meets)
    found = solve_ivp(
        law, (start, end), state, events=ends, rtol=RELATIVE, atol=ABSOLUTE, max_step=2e-3
    )
    state = found.y[:, -1].copy()
    if found.status != 1:
        return end, state, 0
    side = 1 if found.t_events[0].size else -1
    speed = (robot.rotor * state[1] + robot.link * state[3]) / (robot.rotor + robot.link)
    state[1] = state[3] = speed  # an inelastic impact keeps the momentum
    return float(found.t[-1]), state, side


def _joined(
    robot: Pendulum, goal: float, start: float, end: float, state: np.ndarray, apart: float
) -> tuple[float, np.ndarray, int]:
    def bodies(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return y, np.array([y[0] + apart, y[1]])

    def total(y: np.ndarray) -> float:
        motor, link = bodies(y)
        whole = robot.torque(goal, motor, link) + robot.gravity(link[0])
        return whole / (robot.rotor + robot.link)

    def push(t: float, y: np.ndarray) -> float:
        """What the motor's end presses on the link, positive while they are in contact."""
        link = bodies(y)[1]
        force = robot.link * total(y) - robot.gravity(link[0])  # motor on link
        return -np.sign(apart) * force

    push.terminal, push.direction = True, -1.0  # type: ignore[attr-defined]
    side, inside = int(np.sign(apart)), apart * (1 - GRAZE)
    if push(start, state[:2]) < 0:
        return start, np.array([*state[:2], state[0] + inside, state[1]]), 0
    found = solve_ivp(
        lambda t, y: [y[1], total(y)],
        (start, end),
        state[:2],
        events=[push],
        rtol=RELATIVE,
        atol=ABSOLUTE,
        max_step=2e-3,
    )
    motor, speed = found.y[:, -1]
    left = found.status == 1
    state = np.array([motor, speed, motor + (inside if left else apart), speed])
    return float(found.t[-1]), state, 0 if left else side
