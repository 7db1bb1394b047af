"""Sizes of a robot, from which an effect estimates its likely values there.

    scale = RobotScale(model, speeds=lambda actuator: (2.0, 6.0))
    make("coulomb_friction", where="elbow").probes(scale)      # N·m, from the elbow's own torque

What a model says is here; what only recordings say (how fast it was driven, how warm it got) is
passed in by the caller.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import mujoco
import numpy as np

FASTEST = 8.0  # rad/s: of a servo whose commands are not known
VOLTS = 12.0  # V: of an unknown supply
REACHED = 0.5  # rad of error at which a servo without a limit is taken to give its largest torque
SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
LEAST = 1e-3  # N·m: an actuator that moves nothing that weighs, without a known size


def same_speed(actuator: str) -> tuple[float, float]:
    """Return the usual and the largest commanded speed of an unknown motion [rad/s]."""
    return FASTEST, FASTEST


def no_command(actuator: str) -> float:
    """Return the largest command of an unknown motion."""
    return 0.0


def no_heat(actuator: str) -> float:
    """Return a motor's heating by an unknown motion [N²·m²·s]."""
    return 0.0


def any_speed(joint: str) -> float:
    """Return how fast an unknown motion moves a joint [rad/s]."""
    return FASTEST


class RobotScale:
    """Typical magnitudes of one robot.

    Args:
        model: the robot.
        joints: those whose motion is compared; None for every hinge and slide.
        voltage: the voltage of its supply [V]; 0 if unknown.
        speeds: how fast an actuator is commanded to move in all but 3 % of the time, and at most
            [rad/s], by its name.
        heat: what an actuator's squared torque adds up to in the hardest of the logs [N²·m²·s].
        commands: the largest command of an actuator without its sign, in the actuator's own unit.
        touching: names of the geoms that were seen to touch the ground.
        bases: names of bodies whose own motion is compared, though no joint that is moves them.
        feels: whether it is an IMU that says how a floating base turns.
        reached: the speed that a joint passed in a hundredth of the time [rad/s], by its name.

    Attributes:
        actuators: names, in the model's order.
        driven: joint of each actuator that acts on one, by name.
        torque: the largest of each actuator at its joint [N·m], by actuator.
        joint_torque: the same by joint.
        mass: the mass of the whole robot [kg].
        bodies: names of those that compared joints move, and the bases.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        joints: Sequence[str] | None = None,
        voltage: float = 0.0,
        speeds: Callable[[str], tuple[float, float]] = same_speed,
        heat: Callable[[str], float] = no_heat,
        commands: Callable[[str], float] = no_command,
        touching: Sequence[str] = (),
        bases: Sequence[str] = (),
        feels: bool = False,
        reached: Callable[[str], float] = any_speed,
    ) -> None:
        self.model, self.voltage, self.touching = model, voltage, tuple(touching)
        self.feels, self.reached = feels, reached
        every = [j for j in range(model.njnt) if model.jnt_type[j] in SCALAR]
        self.joints = [model.joint(j).name for j in every] if joints is None else list(joints)
        self.speeds, self.heat, self.commands = speeds, heat, commands
        self.actuators = [model.actuator(i).name for i in range(model.nactuator)]
        self.driven = {
            name: model.joint(int(model.actuator_trnid[i, 0])).name
            for i, name in enumerate(self.actuators)
            if int(model.actuator_trntype[i]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        }
        self.torque = {name: self._torque(i) for i, name in enumerate(self.actuators)}
        self.joint_torque = {joint: self.torque[name] for name, joint in self.driven.items()}
        self.mass = float(model.body_mass[1:].sum())
        names = [model.body(i).name for i in range(1, model.nbody)]
        self.bodies = [name for name in names if name in bases or self.carriers(name)]

    def carriers(self, body: str) -> tuple[str, ...]:
        """Return the compared joints that carry a body, the nearest first."""
        model, found = self.model, []
        index = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body))  # -1: none such
        while index > 0:
            first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
            names = [model.joint(j).name for j in range(first, first + count)]
            found += [name for name in reversed(names) if name in self.joints]
            index = int(model.body_parentid[index])
        return tuple(found)

    def _torque(self, i: int) -> float:
        """Return an actuator's largest torque: its limit, else what its gain makes of its error.

        A motor's is what its range of commands makes, else the largest command of the logs; where
        it was never used, the torque that holds what it carries.
        """
        model = self.model
        gear = abs(float(model.actuator_gear[i, 0])) or 1.0
        if model.actuator_forcelimited[i]:
            return float(model.actuator_forcerange[i, 1]) * gear
        stiffness = float(-model.actuator_biasprm[i, 1])
        if stiffness > 0:
            return max(stiffness * REACHED, LEAST) * gear
        if model.actuator_ctrllimited[i]:
            command = float(np.abs(model.actuator_ctrlrange[i]).max())
        else:
            command = self.commands(self.actuators[i])
        torque = command * abs(float(model.actuator_gainprm[i, 0])) * gear
        return torque or max(self._weight(i), LEAST)

    def _weight(self, i: int) -> float:
        """Return the torque [N·m] that holds what an actuator carries, at its heaviest."""
        model, data = self.model, mujoco.MjData(self.model)
        joint = self.driven.get(self.actuators[i])
        if joint is None:
            return 0.0
        mujoco.mj_forward(model, data)
        place = self._joint(joint)
        body = int(model.jnt_bodyid[place])
        force = float(model.body_subtreemass[body] * np.linalg.norm(model.opt.gravity))
        slides = int(model.jnt_type[place]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
        arm = 1.0 if slides else np.linalg.norm(data.subtree_com[body] - data.xanchor[place])
        return force * float(arm)

    def torque_at(self, where: str | None) -> float:
        """Return the largest torque at a joint or actuator; the mean of all elsewhere [N·m]."""
        found = {**self.torque, **self.joint_torque}.get(str(where))
        return found or float(np.mean(list(self.torque.values()) or [1.0]))

    def own(self, field: str, joint: str | None) -> float:
        """Return a joint's entry of one of the model's fields of degrees of freedom.

        The least of all driven joints for None.
        """
        dofs = [int(self.model.jnt_dofadr[place]) for place in self._joints(joint)]
        return float(np.min(getattr(self.model, field)[dofs]))

    def inertia(self, joint: str | None) -> float:
        """Return the inertia of what a joint carries, without armature; None: the mean [kg·m²]."""
        return float(np.mean([link_inertia(self.model, place) for place in self._joints(joint)]))

    def speeds_at(self, actuator: str | None) -> tuple[float, float]:
        """Return usual and largest commanded speed of an actuator; None: of the fastest [rad/s]."""
        each = [self.speeds(name) for name in ([actuator] if actuator else self.actuators)]
        return max(usual for usual, _ in each), max(most for _, most in each)

    def reached_at(self, actuator: str | None) -> float:
        """Return how fast an actuator's joint moved; None: the fastest one [rad/s]."""
        joints = self.driven.values() if actuator is None else [self.driven[actuator]]
        return max(map(self.reached, joints))

    def heat_at(self, actuator: str | None) -> float:
        """Return the heat of an actuator; None: of the warmest [N²·m²·s]."""
        return max(self.heat(name) for name in ([actuator] if actuator else self.actuators))

    def _joints(self, joint: str | None) -> list[int]:
        """Return the id of a joint; None: of every driven one."""
        names = sorted(set(self.driven.values())) if joint is None else [joint]
        return [self._joint(name) for name in names]

    def _joint(self, name: str | None) -> int:
        return int(self.model.joint(str(name)).id)

    def body(self, name: str | None) -> int:
        """Return a body's id."""
        return int(self.model.body(str(name)).id)

    @cached_property
    def known(self) -> dict[str, float]:
        """The supply [V] and the motors' constant [N·m/A], from stall torque and back-EMF.

        Empty where no motor has a stall torque.
        """
        model, volts = self.model, self.voltage or VOLTS
        limits = model.actuator_forcerange[:, 1] * model.actuator_forcelimited.astype(bool)
        if not (limits > 0).any():
            return {}
        damping = np.atleast_2d(model.actuator_damping.reshape(model.nactuator, -1))[:, 0]
        good = (limits > 0) & (damping > 0)
        constant = float(np.mean(volts * damping[good] / limits[good])) if good.any() else 1.0
        return {"voltage": volts, "torque_constant": constant}


def link_inertia(model: mujoco.MjModel, joint: int) -> float:
    """Return the inertia of what a joint carries, at the default pose, without armature [kg·m²]."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    dof = int(model.jnt_dofadr[joint])
    return float(full[dof, dof] - model.dof_armature[dof])
