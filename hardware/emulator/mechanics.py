"""The emulated robot's body: MuJoCo physics with the emulator's own friction, play and springs.

    mechanics = Mechanics(robot, hidden)
    mechanics.step(volts, driven)           # one tick of the servos' firmware
    mechanics.angle, mechanics.speed        # what the encoders and motors see

Laws (n servos, torque on the motor's side of the gear):

* friction: a bristle z that follows the motion and breaks away at 0.5 mrad, or at more if the
  hidden friction says so, carries F z / z_max, with F = coulomb + stribeck exp(-|w / speed|^shape)
  + load_friction |motor torque - external * the torque of gravity and inertia| (Dahl's model in
  its simplest form: Prandtl's stop operator), and viscous friction proportional to w;
* cogging: amplitude sin(count * angle + phase);
* play: no torque inside it, a stiff damped spring at its ends; compliance: a spring across it.
"""

import mujoco
import numpy as np

from hardware.config import Robot
from hardware.emulator.hidden import HiddenEffects
from hardware.emulator.model import build_model, home_pose

TICK = 0.001  # s, one pass of a servo's firmware
DRY = ("coulomb_friction", "stribeck_friction", "load_dependent_friction")
BRISTLE, RATIO = 5e-4, 0.25  # rad, and of critical damping, where no hidden friction has others
STIFFEST = 300.0  # N·m/rad, the ends of a play


def _write_no_log_file() -> None:
    """Keep MUJOCO_LOG.TXT out of the folder that an emulator was started in; see `envs.quiet`."""
    kept = mujoco.MjLogConfig.get()
    kept.logto_file = False
    mujoco.MjLogConfig.set(kept)


class Mechanics:
    """The physics of one robot, moved in ticks of 1 ms by the voltages of its servos.

    Args:
        robot: the robot; it starts at rest in its keyframe `home`.
        hidden: its hidden effects.
    """

    def __init__(self, robot: Robot, hidden: HiddenEffects) -> None:
        play = hidden["backlash"].any() or hidden["joint_compliance"].any()
        self.substeps = 4 if play else 2
        self.model, plays = build_model(robot, hidden, TICK / self.substeps)
        self.data = mujoco.MjData(self.model)
        _write_no_log_file()
        model = self.model
        actuators = [model.actuator(servo.name).id for servo in robot.servos]
        joints = model.actuator_trnid[actuators, 0]
        self._ctrl = model.actuator_ctrladr[actuators]
        self._actuators = np.array(actuators)
        self.qpos = model.jnt_qposadr[joints]
        self.dof = model.jnt_dofadr[joints]
        self._resistance = model.actuator_gainprm[actuators, 0].copy()
        self._set_plays(plays, hidden)
        self._set_laws(hidden)
        self._driven = np.ones(len(actuators), bool)
        self._damping = model.dof_damping[self.dof].copy()
        self._home = self._home_pose(robot)
        self._held: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self.go_home()
        self.set_strength(hidden["motor_strength"])

    def go_home(self) -> None:
        """Put the robot into its keyframe `home`, at rest."""
        self.data.qpos[:] = self._home
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def place(self, joint: int, angle: float) -> None:
        """Put a servo's joint at an angle [rad], at rest."""
        self.data.qpos[self.qpos[joint]], self.data.qvel[self.dof[joint]] = angle, 0.0
        mujoco.mj_forward(self.model, self.data)

    def hold(self, joints: np.ndarray) -> None:
        """Hold these servos' joints where they are, (n,) bool, and with any of them all the rest.

        The rest is what no servo moves, such as a floating base.
        """
        if not joints.any():
            self._held = None
            return
        free = ~joints
        places = np.setdiff1d(np.arange(self.model.nq), self.qpos[free])
        speeds = np.setdiff1d(np.arange(self.model.nv), self.dof[free])
        self._held = places, self.data.qpos[places].copy(), speeds

    @property
    def is_held(self) -> bool:
        """Whether something holds the robot's base, see `hold`."""
        return self._held is not None

    def _home_pose(self, robot: Robot) -> np.ndarray:
        qpos = self.model.qpos0.copy()
        for name, values in home_pose(robot).items():
            start = self.model.jnt_qposadr[self.model.joint(name).id]
            qpos[start : start + len(values)] = values
        return qpos

    def _set_plays(self, plays: dict[int, str], hidden: HiddenEffects) -> None:
        model = self.model
        self._play = np.array(sorted(plays), int)  # (p,) servos with a second joint
        joints = [model.joint(plays[i]).id for i in self._play]
        self._play_qpos, self._play_dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._link_side = np.flatnonzero(hidden.link_side[self._play])
        self._gap = hidden["backlash"][self._play] / 2
        compliance = hidden["joint_compliance"][self._play]
        weight = model.dof_invweight0[self._play_dof]
        stiff = np.minimum(STIFFEST, 0.05 / (model.opt.timestep**2 * weight))
        self._stiffness = np.where(
            compliance > 0, 1 / np.where(compliance > 0, compliance, 1), stiff
        )
        damping = hidden["joint_compliance.damping"][self._play]
        self._play_damping = np.where(compliance > 0, damping, 0.8 * np.sqrt(stiff / weight))

    def _set_laws(self, hidden: HiddenEffects) -> None:
        self._hidden = hidden
        self._rubs = any(hidden[name].any() for name in DRY)
        self._drags = hidden["viscous_friction"].any()
        self._cogs = hidden["cogging"].any()
        bends, ratios = (np.stack([hidden[f"{n}.{e}"] for n in DRY]) for e in ("bristle", "ratio"))
        softest = np.take_along_axis(ratios, bends.argmax(axis=0)[None], axis=0)[0]
        self._deep = np.maximum(bends.max(axis=0), BRISTLE)
        self._ratio = np.where(bends.any(axis=0), softest, RATIO)
        self._bristle = np.zeros(len(self.dof))
        self._inertia = self.model.dof_M0[self.dof] * 1.0
        self._own = self._rubs or self._drags or self._cogs or len(self._play)

    @property
    def angle(self) -> np.ndarray:
        """The encoders' angles [rad along the joints], (n,)."""
        angle = self.data.qpos[self.qpos]
        if len(self._link_side):
            angle[self._play[self._link_side]] += self.data.qpos[self._play_qpos[self._link_side]]
        return angle

    @property
    def joint_angle(self) -> np.ndarray:
        """The links' angles [rad], (n,): beyond any play."""
        angle = self.data.qpos[self.qpos]
        angle[self._play] += self.data.qpos[self._play_qpos]
        return angle

    @property
    def speed(self) -> np.ndarray:
        """Speed of the motors' side [rad/s along the joints], (n,)."""
        return self.data.qvel[self.dof]

    @property
    def torque(self) -> np.ndarray:
        """Torque of the motors at the joints [N·m], (n,)."""
        return self.data.actuator_force[self._actuators]

    def sensors(self) -> dict[str, np.ndarray]:
        """Return the values of the model's sensors by name, such as an IMU's, as last computed."""
        model, values = self.model, self.data.sensordata
        spans = zip(model.sensor_adr, model.sensor_dim, strict=True)
        return {
            model.sensor(i).name: values[start : start + size].copy()
            for i, (start, size) in enumerate(spans)
        }

    def drive(self, volts: np.ndarray, driven: np.ndarray) -> None:
        """Set the voltages [V along the joints], (n,), and which motors are on, (n,) bool."""
        self.data.ctrl[self._ctrl] = volts
        if (driven != self._driven).any():
            self._driven = driven.copy()
            off = 0
            for i in np.flatnonzero(~driven):
                off |= 1 << int(i)
            self.model.opt.disableactuator = off

    def set_strength(self, factor: np.ndarray) -> None:
        """Scale all torque of the motors, (n,): K V / R and K^2 / R alike, through R."""
        self.strength = factor
        self.model.actuator_gainprm[self._actuators, 0] = self._resistance / np.maximum(
            factor, 1e-6
        )

    def lock(self, servo: int, locked: bool) -> None:
        """Jam a servo's joint, or free it."""
        self.model.dof_damping[self.dof[servo]] = 1e4 if locked else self._damping[servo]

    def step(self) -> None:
        """Advance the physics by one tick of the firmware."""
        if self._own:
            for _ in range(self.substeps):
                self._apply()
                mujoco.mj_step(self.model, self.data)
        else:
            mujoco.mj_step(self.model, self.data, self.substeps)
        if self._held is not None:
            places, values, speeds = self._held
            self.data.qpos[places], self.data.qvel[speeds] = values, 0.0

    def _apply(self) -> None:
        """Write the torques of the emulator's own laws."""
        data, hidden = self.data, self._hidden
        speed = data.qvel[self.dof]
        torque = np.zeros(len(self.dof))
        if self._drags:
            torque -= hidden["viscous_friction"] * speed
        if self._rubs:
            torque -= self._friction(speed)
        if self._cogs:
            turn = hidden["cogging.count"] * data.qpos[self.qpos] + hidden["cogging.phase"]
            torque += hidden["cogging"] * np.sin(turn)
        data.qfrc_applied[self.dof] = torque
        if len(self._play):
            data.qfrc_applied[self._play_dof] = self._play_torque()

    def _friction(self, speed: np.ndarray) -> np.ndarray:
        hidden = self._hidden
        ratio = np.abs(speed / hidden["stribeck_friction.speed"])
        slow = np.exp(-(ratio ** hidden["stribeck_friction.shape"]))
        level = hidden["coulomb_friction"] + hidden["stribeck_friction"] * slow
        external = hidden["load_dependent_friction.external"] * self.data.qfrc_bias[self.dof]
        level = level + hidden["load_dependent_friction"] * np.abs(self.torque + external)
        bristle = self._bristle + speed * self.model.opt.timestep
        self._bristle = np.clip(bristle, -self._deep, self._deep)
        held = 1 - np.abs(self._bristle) / self._deep
        damping = 2 * self._ratio * np.sqrt(level / self._deep * self._inertia)
        return level * self._bristle / self._deep + damping * held * speed

    def _play_torque(self) -> np.ndarray:
        angle = self.data.qpos[self._play_qpos]
        beyond = angle - np.clip(angle, -self._gap, self._gap)
        damping = self._play_damping * self.data.qvel[self._play_dof] * (beyond != 0)
        return -self._stiffness * beyond - damping
