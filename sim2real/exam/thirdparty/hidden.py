"""Effects that these robots can hide, with places and sizes.

    effects = known(rig)                            # names that this robot can have
    truth = LAWS["backlash"].draw(rig, "elbow", rng)(0.03)  # of a size: an entry of an effects.yaml
    other = put(rig, {"effect": "backlash", **truth})       # the robot that hides it

A size is a positive number in which every effect grows from nothing. The models are those of this
package's other modules; the names are the vocabulary's, and nothing else is shared with it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from sim2real.exam.thirdparty.gear import Gear
from sim2real.exam.thirdparty.rig import Rig

Form = Literal["add", "signed", "factor", "limit", "mass", "tilt"]
Truth = dict[str, Any]  # {effect, where, side, value, extra, joint, shared, encoder}
Put = Callable[[Rig, Truth], Rig]
HARD, DAMPED = 80.0, 0.4  # Hz and damping ratio at which a rotor meets the end of its play
SOFT = 0.1  # damping ratio of a rotor on an elastic joint
KNEE = 2.0  # stall torque over the torque limit of a motor with a torque-speed knee
SLACK = 50.0  # N·m/rad: the stiffness that compliance is measured by where no loop has one


@dataclass(frozen=True)
class Law:
    """One effect of the vocabulary."""

    place: Literal["joint", "body", "robot"]  # what it acts on
    form: Form  # how a size becomes a value
    unit: str  # what a size multiplies; see `units`
    low: float  # the smallest size
    high: float  # the largest
    put: Put  # what it does to a robot
    sides: tuple[str, ...] = ()  # where its encoders may sit
    # draws its further scalars
    extra: Callable[[np.random.Generator], dict[str, float]] = lambda rng: {}

    def draw(self, rig: Rig, joint: str | None, rng: np.random.Generator) -> Callable[[float], Any]:
        """Draw sign, side and extras at a place; return what makes a truth of a size."""
        sign, turn = rng.choice([-1.0, 1.0]), rng.uniform(-math.pi, math.pi)
        side = str(rng.choice(list(self.sides))) if self.sides else None
        unit = units(rig, joint)[self.unit]
        where = rig.tree.mover(joint).body if joint and self.place == "body" else joint
        extra = self.extra(rng)

        def truth(size: float) -> Truth:
            values: Mapping[Form, Callable[[], Any]] = {  # a limit's size is beyond any factor's
                "add": lambda: size * unit,
                "signed": lambda: sign * size * unit,
                "factor": lambda: math.exp(sign * size),
                "limit": lambda: unit / size,
                "mass": lambda: unit * math.expm1(sign * size),
                "tilt": lambda: [size * math.cos(turn), size * math.sin(turn)],
            }
            return {
                "where": where if self.place != "robot" else None,
                "joint": joint if self.place != "robot" else None,
                "side": side,
                "value": values[self.form](),
                "extra": extra,
            }

        return truth


def units(rig: Rig, joint: str | None) -> dict[str, float]:
    """Return the unit of sizes at a joint; for the robot, that of its first joint."""
    name = joint or rig.driven[0]
    one, link = rig.joints[name], rig.tree.mover(name)
    servo = one.servo
    assert servo is not None
    braking = servo.braking + servo.kd + one.friction.viscous
    return {
        "one": 1.0,
        "stall": servo.limit,
        "braking": braking,
        "softness": 1 / (servo.kp or SLACK),
        "inertia": one.inertia,
        "heating": 1 / (servo.limit**2 * 24.0),
        "fastest": 20.0,
        "sharpest": 2000.0,
        "mass": link.mass,
        "length": float(np.linalg.norm(far_end(rig, name))),
    }


def far_end(rig: Rig, joint: str) -> np.ndarray:
    """Return where a link ends, in its frame: at its child, else at twice its centre [m], (3,)."""
    links = rig.tree.links
    link = rig.tree.mover(joint)
    children = [one for one in links if one.parent >= 0 and links[one.parent].body == link.body]
    if children:
        return children[0].position
    return rig.ends.get(link.body, 2 * link.centre)


def known(rig: Rig) -> list[str]:
    """Return the effects that a robot can have."""
    joints = [joint for joint in rig.joints.values() if joint.servo]
    servos = [joint.servo for joint in joints if joint.servo]
    lacking: set[str] = set()
    if any(servo.torque for servo in servos):
        lacking |= POSITION
    if not all(servo.kd for servo in servos):
        lacking |= {"derivative_gain"}
    if not all(servo.braking for servo in servos):
        lacking |= {"supply_voltage"}
    return [name for name in LAWS if name not in lacking]


def put(rig: Rig, truth: Truth) -> Rig:
    """Return the robot that hides one effect."""
    law = LAWS[truth["effect"]]
    if not truth.get("shared"):
        return law.put(rig, truth)
    for joint in rig.driven:
        rig = law.put(rig, {**truth, "joint": joint})
    return rig


def _of_servo(name: str, how: Literal["set", "scale", "add"] = "set") -> Put:
    def change(rig: Rig, truth: Truth) -> Rig:
        joints = [truth["joint"]] if truth["joint"] else rig.driven
        for joint in joints:
            old, value = getattr(rig.joints[joint].servo, name), truth["value"]
            new = {"set": value, "scale": old * value, "add": old + value}[how]
            rig = rig.servo(joint, **{name: new})
        return rig

    return change


def _of_friction(name: str, *further: str) -> Put:
    def change(rig: Rig, truth: Truth) -> Rig:
        joint = truth["joint"]
        old = getattr(rig.joints[joint].friction, name)
        extra = {key: truth["extra"][key] for key in further}
        return rig.friction(joint, **{name: old + truth["value"], **extra})

    return change


def _integral(rig: Rig, truth: Truth) -> Rig:
    """Integral action is given as a share of the gain in a second [1/s]."""
    servo = rig.joints[truth["joint"]].servo
    assert servo is not None
    return rig.servo(truth["joint"], ki=truth["value"] * servo.kp)


def _knee(rig: Rig, truth: Truth) -> Rig:
    """A line falls from twice the limit at rest to the limit at the knee, and to 0 beyond."""
    servo = rig.joints[truth["joint"]].servo
    assert servo is not None
    return rig.servo(truth["joint"], stall=KNEE * servo.limit, no_load=KNEE * truth["value"])


def _armature(rig: Rig, truth: Truth) -> Rig:
    old = rig.joints[truth["joint"]].armature
    return rig.change(truth["joint"], armature=old + truth["value"])


def _offset(rig: Rig, truth: Truth) -> Rig:
    return rig.change(truth["joint"], offset=truth["value"])


def _eccentric(rig: Rig, truth: Truth) -> Rig:
    about = {"eccentric": truth["value"], "phase": truth["extra"]["phase"]}
    return rig.change(truth["joint"], **about)


def _geared(rig: Rig, truth: Truth, gear: Gear) -> Rig:
    side, log = truth["side"], truth.get("encoder") or truth["side"]
    return rig.change(truth["joint"], gear=gear, servo_reads=side, log_reads=log)


def _play(rig: Rig, truth: Truth) -> Rig:
    rotor = rig.joints[truth["joint"]].armature
    beat = 2 * math.pi * HARD
    gear = Gear(rotor * beat**2, 2 * DAMPED * rotor * beat, truth["value"])
    return _geared(rig, truth, gear)


def _spring(rig: Rig, truth: Truth) -> Rig:
    rotor, stiffness = rig.joints[truth["joint"]].armature, 1 / truth["value"]
    return _geared(rig, truth, Gear(stiffness, 2 * SOFT * math.sqrt(stiffness * rotor)))


def _hysteretic(rig: Rig, truth: Truth) -> Rig:
    """A spring with dry friction parallel to it, between the same two sides."""
    soft = _spring(rig, truth)
    gear = soft.joints[truth["joint"]].gear
    assert gear is not None
    stall = units(rig, truth["joint"])["stall"]
    return soft.change(truth["joint"], gear=replace(gear, rub=truth["extra"]["share"] * stall))


def _cogging(rig: Rig, truth: Truth) -> Rig:
    count, phase, size = truth["extra"]["count"], truth["extra"]["phase"], truth["value"]

    def pull(time: float, angle: float, speed: float) -> float:
        return size * math.sin(count * angle + phase)

    joint = truth["joint"]
    return rig.change(joint, pulls=(*rig.joints[joint].pulls, pull))


def _command_delay(rig: Rig, truth: Truth) -> Rig:
    return replace(rig, bus=replace(rig.bus, command_delay=truth["value"]))


def _reading_delay(rig: Rig, truth: Truth) -> Rig:
    return replace(rig, bus=replace(rig.bus, reading_delay=truth["value"]))


def _link_mass(rig: Rig, truth: Truth) -> Rig:
    mass = rig.tree.link(truth["where"]).mass + truth["value"]
    return replace(rig, tree=rig.tree.change(truth["where"], mass=mass))


def _centre(rig: Rig, truth: Truth) -> Rig:
    end = far_end(rig, truth["joint"])
    centre = rig.tree.link(truth["where"]).centre + truth["value"] * end / np.linalg.norm(end)
    return replace(rig, tree=rig.tree.change(truth["where"], centre=centre))


def _payload(rig: Rig, truth: Truth) -> Rig:
    end = far_end(rig, truth["joint"])
    return replace(rig, tree=rig.tree.load(truth["where"], truth["value"], end))


def _inertia(rig: Rig, truth: Truth) -> Rig:
    inertia = rig.tree.link(truth["where"]).inertia * truth["value"]
    return replace(rig, tree=rig.tree.change(truth["where"], inertia=inertia))


def _tilt(rig: Rig, truth: Truth) -> Rig:
    x, y = truth["value"]
    around_x = np.array([[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]])
    around_y = np.array([[math.cos(y), 0, math.sin(y)], [0, 1, 0], [-math.sin(y), 0, math.cos(y)]])
    return replace(rig, tree=replace(rig.tree, gravity=around_y @ around_x @ rig.tree.gravity))


def _stribeck(rng: np.random.Generator) -> dict[str, float]:
    return {"speed": float(rng.uniform(0.2, 1.0))}


def _hysteresis(rng: np.random.Generator) -> dict[str, float]:
    return {"share": float(rng.uniform(0.01, 0.05))}  # of the motor's limit


def _phase(rng: np.random.Generator) -> dict[str, float]:
    return {"phase": float(rng.uniform(-3, 3))}


def _teeth(rng: np.random.Generator) -> dict[str, float]:
    return {"count": float(rng.integers(6, 30)), "phase": float(rng.uniform(-3, 3))}


SIDES = ("motor", "link")
LAWS: Mapping[str, Law] = {
    "coulomb_friction": Law("joint", "add", "stall", 0.002, 0.3, _of_friction("coulomb")),
    "viscous_friction": Law("joint", "add", "braking", 0.02, 10, _of_friction("viscous")),
    "stribeck_friction": Law(
        "joint", "add", "stall", 0.002, 0.3, _of_friction("excess", "speed"), extra=_stribeck
    ),
    "load_dependent_friction": Law("joint", "add", "one", 0.005, 0.6, _of_friction("load")),
    "asymmetric_friction": Law("joint", "signed", "stall", 0.002, 0.2, _of_friction("skew")),
    "cogging": Law("joint", "add", "stall", 0.002, 0.2, _cogging, extra=_teeth),
    "armature": Law("joint", "add", "inertia", 0.03, 10, _armature),
    "backlash": Law("joint", "add", "one", 0.003, 0.25, _play, SIDES),
    "joint_compliance": Law("joint", "add", "softness", 0.01, 3, _spring, SIDES),
    "hysteretic_compliance": Law(
        "joint", "add", "softness", 0.01, 3, _hysteretic, SIDES, extra=_hysteresis
    ),
    "position_gain": Law("joint", "factor", "one", 0.02, 1.2, _of_servo("kp", "scale")),
    "derivative_gain": Law("joint", "factor", "one", 0.05, 1.5, _of_servo("kd", "scale")),
    "integral_action": Law("joint", "add", "one", 0.01, 10, _integral),
    "motor_strength": Law("joint", "factor", "one", 0.02, 0.8, _of_servo("strength", "scale")),
    "torque_limit": Law("joint", "limit", "stall", 1.05, 20, _of_servo("limit")),
    "torque_speed_knee": Law("joint", "limit", "fastest", 2.0, 200, _knee),
    "actuator_lag": Law("joint", "add", "one", 0.001, 0.2, _of_servo("lag")),
    "thermal_derating": Law("joint", "add", "heating", 0.001, 100, _of_servo("heating")),
    "dead_zone": Law("joint", "add", "one", 0.003, 0.12, _of_servo("dead_zone")),
    "profile_velocity": Law("joint", "limit", "fastest", 1, 100, _of_servo("fastest")),
    "profile_acceleration": Law("joint", "limit", "sharpest", 1, 1000, _of_servo("sharpest")),
    "supply_voltage": Law("robot", "factor", "one", 0.02, 0.6, _of_servo("supply", "scale")),
    "command_delay": Law("robot", "add", "one", 0.001, 0.1, _command_delay),
    "observation_delay": Law("robot", "add", "one", 0.001, 0.1, _reading_delay),
    "encoder_offset": Law("joint", "signed", "one", 0.003, 0.3, _offset),
    "encoder_eccentricity": Law("joint", "add", "one", 0.002, 0.2, _eccentric, extra=_phase),
    "link_mass": Law("body", "mass", "mass", 0.02, 1.2, _link_mass),
    "center_of_mass": Law("body", "signed", "length", 0.03, 1.2, _centre),
    "payload": Law("body", "add", "mass", 0.01, 2.5, _payload),
    "link_inertia": Law("body", "factor", "one", 0.1, 2.5, _inertia),
    "gravity_tilt": Law("robot", "tilt", "one", 0.005, 0.5, _tilt),
}
POSITION = {  # effects of a loop of position
    *("position_gain", "derivative_gain", "integral_action", "dead_zone"),
    *("profile_velocity", "profile_acceleration", "backlash", "joint_compliance"),
    *("hysteretic_compliance",),
}
WIDE = (  # effects that a whole robot shares
    *("motor_strength", "position_gain", "derivative_gain", "coulomb_friction"),
    *("viscous_friction", "load_dependent_friction", "thermal_derating"),
)
TWO_SIDED = ("backlash", "joint_compliance", "hysteretic_compliance")
