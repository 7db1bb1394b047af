"""A task on a servo robot: the same functions for its simulation and for the robot itself.

    task = Quad8(fidelity="servo")
    state = task.state_from_measurement(angle, speed, commanded, orientation=quaternion)
    goal = task.command(state, policy(task.observe(state)))        # rad, within the robot's limits

`observe`, `command`, `reward` and `terminated` depend on nothing but the state, and that on nothing
but what a robot measures: the servos' angles, speeds and torques, an IMU, the time since the
episode's start and the last action. Where the base is (`position`) only the reward uses.

Two fidelities simulate the same servos (see `envs.tasks.servo.drive`). `servo` also has the
commands' delay, goals and angles in counts, speeds filtered as the firmware does, and readings that
are as old as the bus makes them.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, get_args

import mujoco
import numpy as np

from envs.effects.base import Effect
from envs.effects.pwm_slope import PwmSlope
from envs.effects.registry import make
from envs.errors import TaskError, refuse_unknown
from envs.noise import uniform
from envs.physics.arrays import Array, Arrays
from envs.quiet import no_deprecation_notice
from envs.servo_numbers import remove_servo_numbers
from envs.tasks.base import CommandState, State, Task
from envs.tasks.servo.drive import COUNT, ideal, max_torque_rate, servo
from envs.tasks.servo.robot import read_machine

Fidelity = Literal["ideal", "servo"]
ASSETS = Path(__file__).parents[2] / "assets"
TIMESTEP = 0.001  # s, of the physics: one pass of the firmware's loop
SPEED_FILTER = 0.005  # s, of a servo's reported speed; no maker publishes it
SETTLE = 1.0  # s, that a robot holds its pose before an episode
OLDEST = 0.01  # s, that a reading may be, or twice what the robot's file says
START_NOISE = 0.02  # rad, largest deviation of the starting angles from the home pose


class ServoTask(Task):
    """One task on one servo robot with n servos.

    Args:
        fidelity: "ideal" (stiff position actuators) or "servo" (motor and firmware).
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        seconds: length of an episode [s].

    Attributes:
        asset: the model's file in envs/assets; episodes start where it comes to rest when its
            keyframe `home` is held.
        machine: the robot's limits, rate and servos.

    Raises:
        TaskError: an unknown fidelity, robot or servo, or a rate that the physics cannot keep.
    """

    asset: ClassVar[str]
    array_api = True
    commands = True
    extra_field = "actuator_force"
    camera = "side"
    frame_skip: int

    def __init__(self, fidelity: Fidelity, robot: str | Mapping[str, Any], seconds: float) -> None:
        refuse_unknown("fidelity", fidelity, get_args(Fidelity), TaskError)
        self.fidelity, self.robot, self.seconds = fidelity, robot, seconds
        with no_deprecation_notice():
            spec = mujoco.MjSpec.from_file(str(ASSETS / self.asset))
        self.machine = read_machine(robot, [a.name for a in spec.actuators])
        steps = 1.0 / (self.machine.rate * TIMESTEP)
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-9:
            raise TaskError(
                f"{self.machine.name}: a rate of {self.machine.rate} per second is not a whole "
                f"number of physics steps of {TIMESTEP} s; choose a divisor of {1 / TIMESTEP:.0f}"
            )
        self.frame_skip = round(steps)
        self.max_steps = round(seconds * self.machine.rate)
        if self.max_steps < 1:
            raise TaskError(f"seconds={seconds} is less than one control step")
        self.setup(self.spec().compile())

    def spec(self) -> mujoco.MjSpec:
        """Return the robot with its actuators at this fidelity."""
        machine = self.machine
        with no_deprecation_notice():
            spec = mujoco.MjSpec.from_file(str(ASSETS / self.asset))
        remove_servo_numbers(spec)
        spec.option.timestep = TIMESTEP
        # one robot is one island: the same bits without the search for islands, a tenth sooner
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        for i, actuator in enumerate(spec.actuators):
            kind = machine.kinds[i]
            if self.fidelity == "ideal":
                ideal(actuator, kind)
            else:
                settings = machine.registers[i], machine.voltage[i], machine.delay, TIMESTEP
                servo(actuator, kind, *settings)
        return spec

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off where the servos are in the model, and where it rests in the home pose."""
        super().setup(model)
        self.start = settled_pose(model)
        joints = model.actuator_trnid[:, 0]
        self.q, self.v = model.jnt_qposadr[joints], model.jnt_dofadr[joints]  # (n,) each
        self._damping = model.actuator_damping.copy()  # (n,) back-EMF

    def on(self, arrays: Arrays) -> Self:
        """Return the task, its robot's limits included, for an engine's arrays."""
        other = super().on(arrays)
        if other is not self:
            own = {key: arrays.own(value) for key, value in vars(self.machine).items()}
            other.machine = replace(self.machine, **own)
        return other

    def fixed(self) -> Sequence[tuple[Effect, Sequence[float]]]:
        """Return the servos' effects on readings, and a slow voltage if the registers set one."""
        if self.fidelity == "ideal":
            return ()
        machine = self.machine
        own: list[tuple[Effect, Sequence[float]]] = [
            (make("quantization"), (COUNT,)),
            (make("velocity_filter"), (SPEED_FILTER,)),
            (make("observation_delay", longest=max(OLDEST, 2 * machine.age)), (machine.age,)),
        ]
        rates = [
            max_torque_rate(k, r) for k, r in zip(machine.kinds, machine.registers, strict=True)
        ]
        return own if np.isinf(rates).all() else [*own, (PwmSlope(np.array(rates)), ())]

    def rest(self, model: mujoco.MjModel) -> np.ndarray:
        """Return the home pose as the servos' goals [rad], (n,)."""
        return model.key("home").ctrl.copy()

    def initial(self, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states of robots that rest in the home pose, each servo off by up to 20 mrad."""
        qpos = np.tile(self.start, (len(seeds), 1))
        noise = 2.0 * uniform(seeds, 0, len(self.q)) - 1.0
        qpos[:, self.q] += START_NOISE * noise
        return qpos, np.zeros((len(seeds), self.nv))

    def command(self, state: State, action: Array) -> Array:
        """Return the goals to send [rad], (n, servos): within the robot's limits, in counts."""
        machine, last = self.machine, commanded(state).goal
        xp = self.xp
        goal = xp.clip(self.target_angles(state, action), machine.low, machine.high)
        goal = xp.clip(goal, last - machine.most_step, last + machine.most_step)
        return goal if self.fidelity == "ideal" else xp.round(goal / COUNT) * COUNT

    @abstractmethod
    def target_angles(self, state: State, action: Array) -> Array:
        """Return the goals that an action asks for [rad], (n, servos), before any limit."""

    def state_from_measurement(
        self,
        angle: np.ndarray,
        speed: np.ndarray,
        command: CommandState,
        orientation: np.ndarray | None = None,
        gyro: np.ndarray | None = None,
        position: np.ndarray | None = None,
        torque: np.ndarray | None = None,
    ) -> State:
        """Return the state that n robots measure.

        Args:
            angle: of the servos [rad], (n, servos) in the order of the model's actuators.
            speed: of the servos [rad/s], (n, servos).
            command: time, last action and last goals.
            orientation: of the base, a unit quaternion w x y z, (n, 4); None for level.
            gyro: angular velocity about the base's own axes [rad/s], (n, 3); None for 0.
            position: of the base from an external tracker [m], (n, 3); None where it is unknown:
                the reward is then that of a robot that stays where it is.
            torque: of the motors [N·m], (n, servos); None for 0.
        """
        n = len(angle)
        qpos, qvel = np.tile(self.start, (n, 1)), np.zeros((n, self.nv))
        qpos[:, self.q], qvel[:, self.v] = angle, speed
        self.write_base_pose(qpos, qvel, orientation, gyro, position)
        torque = np.zeros((n, len(self.q))) if torque is None else torque
        return State(qpos, qvel, torque + self._damping * speed, None, command)

    def write_base_pose(
        self,
        qpos: np.ndarray,
        qvel: np.ndarray,
        orientation: np.ndarray | None,
        gyro: np.ndarray | None,
        position: np.ndarray | None,
    ) -> None:
        """Write what is measured of the base into qpos (n, nq) and qvel (n, nv); it has none."""

    def with_distance_reward(self) -> Self | None:
        """Return the same task, paid for distance [m] at any speed, less its other costs.

        Where nothing tracks the base, a person who measures the distance knows the return of that
        task. None: distance is not what this one is paid for.
        """
        return None

    def torque(self, state: State) -> Array:
        """Return the motors' torques [N·m], (n, servos): what the law asks less back-EMF."""
        if state.extra is None:
            raise TaskError(
                f"{type(self).__name__} needs the motors' torques: give State.extra ="
                " actuator_force, or build the state with measured(torque=...)"
            )
        return state.extra - self._damping * state.qvel[:, self.v]

    def power(self, state: State) -> Array:
        """Return the sum of |torque x speed| over the servos [W], (n,)."""
        return self.xp.sum(self.xp.abs(self.torque(state) * state.qvel[:, self.v]), axis=1)


def settled_pose(model: mujoco.MjModel) -> np.ndarray:
    """Return where the robot comes to rest holding its keyframe `home`, (nq,).

    Soft servos sag, and a robot that starts an episode did so before. A floating base stays above
    the keyframe's point of the ground.
    """
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_step(model, data, round(SETTLE / model.opt.timestep))
    floating = int(model.jnt_type[0]) == int(mujoco.mjtJoint.mjJNT_FREE)
    free = slice(0, 2 if floating else 0)
    data.qpos[free] = model.key("home").qpos[free]
    return data.qpos.copy()


def commanded(state: State) -> CommandState:
    """Return the command; raises TaskError for a state without one."""
    if state.command is None:
        raise TaskError(
            "a servo task needs the time, the last action and the last goals: give State.command"
        )
    return state.command


def clock(state: State, frequency: float) -> Array:
    """Return the phase of a rhythm [1/s] at the state's time [rad], (n,)."""
    return 2.0 * np.pi * frequency * commanded(state).time
