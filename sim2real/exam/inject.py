"""Known effects hidden in real logs: what the exam cannot make up, real friction and real noise.

    exam = RealExam(data="data", each=2)            # the folder of SIM2REAL_DATA
    exam.make(exam.draw(seed=3)[0], logs, key)

What a real robot hides is unknown, but what is added on top of it is known. The simulator is
first given what is known of the robot (`BASES`); then one thing is made wrong:

    observation_delay   measured positions are moved to later times
    encoder_offset      commands and positions are shifted together, as a wrong zero does
    position_gain       the simulator gets another gain
    link_mass           ... another mass
    coulomb_friction    ... no friction in one joint

The gap that this opens is what the diagnosis should name and close; what the known effects leave of
the untouched logs stays in them. Logs are cut to half a minute. One is held back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import Effect, make, write_effects
from hardware.log import Log, read_log, write_log
from hardware.stand import MODEL
from sim2real.exam.cases import Case, write_task
from sim2real.exam.hold import KNOWN, Examiner, Outline, check_data
from sim2real.exam.logs import overall
from sim2real.exam.measure import apart
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

PART = 30.0  # s of each log
WORSE = 1.3  # least ratio of an injected gap to the gap before
TRIES = 6  # sizes that are tried for that


class Base(NamedTuple):
    """A real robot, and the parameters of its simulator."""

    folder: str  # below the data folder
    model: str  # its MJCF there
    joints: tuple[str, ...]  # those that are compared; others are taken out of model and logs
    held: str  # the log that is held back
    files: tuple[str, ...]  # the logs that a diagnosis is given
    known: tuple[tuple[str, str, float], ...]  # effects as (name, joint, value, extra)
    where: Mapping[str, tuple[str, ...]]  # the places of each injected effect


def _bench(gain: int) -> Base:
    """The XL330 bench at one gain: friction of its published model, gain of its PWM column."""
    return Base(
        "xl330_bench",
        f"model_p{gain}.xml",
        ("hinge",),
        f"p{gain}_sin_sin",
        (f"p{gain}_up_and_down", f"p{gain}_sin_time_square", f"p{gain}_lift_and_drop"),
        (
            ("position_gain", "hinge", 0.5),
            ("coulomb_friction", "hinge", 0.0128),
            ("load_dependent_friction", "hinge", 0.2),
        ),
        {
            "observation_delay": ("",),
            "encoder_offset": ("hinge",),
            "position_gain": ("hinge",),
            "link_mass": ("arm",),
        },
    )


ARM = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
# on top of the arm's public model: what `python -m benchmarks.so101` finds, joint by joint
FOUND = {
    "position_gain": (0.0135, 0.0135, 0.0118, 0.0109, 0.0691),  # factors
    "derivative_gain": (0.00366, 0.0128, 0.00746, 0.00687, None),  # factors
    "coulomb_friction": (0.0616, 0.369, 0.378, 0.0949, 0.841),  # N·m
    "viscous_friction": (0.434, None, 0.25, 0.225, None),  # N·m·s/rad
}
BASES: Mapping[str, Base] = {
    "xl330_p200": _bench(200),
    "xl330_p100": _bench(100),
    "so101": Base(
        "so101",
        "so101.xml",
        ARM,
        "velocity_ramp",
        ("step_response", "friction_gravity"),
        tuple(
            (name, joint, value)
            for name, values in FOUND.items()
            for joint, value in zip(ARM, values, strict=True)
            if value is not None
        ),
        {
            "position_gain": ("shoulder_lift", "elbow_flex", "wrist_flex"),
            "link_mass": ("gripper", "wrist", "lower_arm"),
            "coulomb_friction": ("shoulder_lift", "elbow_flex", "wrist_roll"),
        },
    ),
}
Range = tuple[float, float]
# Least and largest sizes: s, rad, and logarithms of factors. The arm shows less of them.
SIZES: Mapping[str, Mapping[str, Range]] = {
    "xl330_bench": {
        "observation_delay": (0.02, 0.1),
        "encoder_offset": (0.1, 0.3),
        "position_gain": (0.4, 1.0),
        "link_mass": (0.4, 1.0),
    },
    "so101": {"position_gain": (0.5, 1.5), "link_mass": (0.7, 2.5), "coulomb_friction": (1.0, 1.0)},
}


@dataclass(frozen=True)
class RealExam(Examiner):
    """Real logs with one known effect hidden in each case.

    Raises:
        Sim2RealError: no case; from `draw`: no folder, or one without these logs.
    """

    data: str | None  # the folder of real logs, which the environment variable SIM2REAL_DATA names
    each: int  # cases of each robot and effect; places and sizes are drawn for each

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.each < 1:
            raise Sim2RealError(f"each={self.each} must be at least 1")

    def draw(self, seed: int) -> list[Outline]:
        """Return the cases; the same seed gives the same ones."""
        for robot, base in BASES.items():
            check_data(self.data, f"{base.folder}/{base.model}", robot)
        wanted = [
            (robot, (effect,))
            for robot, base in BASES.items()
            for effect in base.where
            for _ in range(self.each)
        ]
        order = np.random.default_rng([seed, 0]).permutation(len(wanted))
        seeds = np.random.SeedSequence(seed).generate_state(len(wanted))
        return [
            Outline(f"case_{i:03d}", "one", wanted[k][0], wanted[k][1], int(seeds[i]))
            for i, k in enumerate(order.tolist())
        ]

    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Write a case; see `Examiner`. False if no size opens a gap that stands out."""
        base = BASES[outline.robot]
        (effect,) = outline.effects
        rng = np.random.default_rng([outline.seed, 1])
        where = str(rng.choice(base.where[effect])) or None
        up = bool(rng.integers(2))
        spec = keep_joints(self._folder(base) / base.model, base.joints)
        model = spec.copy().compile()
        held = self._log(base, base.held)
        residue = overall(apart(held, spec, _effects(base.known)))
        low, high = SIZES[base.folder][effect]
        for size in np.linspace(rng.uniform(low, high), high, TRIES).tolist():
            lie = inject(effect, where, size if up else -size, base, model)
            gap = overall(apart(lie.change(held), lie.spec(spec), _effects(lie.known)))
            if gap >= WORSE * residue:
                break
        else:
            return False
        self._write(base, lie, spec, logs, key)
        joint_of = {model.body(int(model.jnt_bodyid[j])).name: j for j in range(model.njnt)}
        bodies = {body: model.joint(j).name for body, j in joint_of.items()}
        joint = bodies.get(where, where) if where else None
        truth = {"effect": effect, "where": where, "joint": joint, "side": None, "extra": {}}
        truths = ({**truth, "value": lie.value, "gap": gap},)
        where_from = (outline.name, "one", outline.robot, outline.seed)
        Case(*where_from, truths, gap, residue, residue, (), base.joints, bodies).write(key)
        return True

    def _folder(self, base: Base) -> Path:
        return Path(self.data or "") / base.folder

    def _log(self, base: Base, name: str) -> Log:
        return shortened(read_log(self._folder(base) / f"{name}.csv"), base.joints)

    def _write(self, base: Base, lie: Lie, spec: mujoco.MjSpec, logs: Path, key: Path) -> None:
        path = write_text(logs / MODEL, lie.spec(spec).to_xml())
        for folder, names in ((logs, base.files), (key, (base.held,))):
            for number, name in enumerate(names):
                log = lie.change(self._log(base, name))
                log = replace(log, meta={"robot": base.folder, "model": str(path.resolve())})
                stem = "held" if folder == key else "abc"[number]
                folder.mkdir(parents=True, exist_ok=True)
                write_log(folder / f"{stem}.csv", log)
        write_effects(logs / KNOWN, _effects(lie.known))
        write_task(logs, (), KNOWN)


class Lie(NamedTuple):
    """One thing made wrong: in the logs, in the simulator's inputs, or in its masses."""

    value: float  # of the effect that undoes it
    known: Sequence[tuple[str, str, float]]
    delay: float = 0.0  # s
    offset: tuple[str, float] | None = None  # joint, rad
    mass: tuple[str, float] | None = None  # body, kg added to what it weighs

    def change(self, log: Log) -> Log:
        """Return the log with its columns made wrong."""
        columns = dict(log.columns)
        if self.delay:
            for name in [c for c in columns if c.startswith(("qpos.", "qvel."))]:
                columns[name] = np.interp(log.time - self.delay, log.time, columns[name])
        if self.offset:
            joint, by = self.offset
            for name in (f"qpos.{joint}", f"ctrl.{joint}"):
                columns[name] = columns[name] + by
        return Log(columns, log.meta)

    def spec(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Return the model with its mass made wrong."""
        spec = spec.copy()
        if self.mass:
            body, more = self.mass
            spec.body(body).mass += more
        return spec


def inject(effect: str, where: str | None, size: float, base: Base, model: mujoco.MjModel) -> Lie:
    """Return the lie that makes an effect necessary, and its value.

    Args:
        effect: its name.
        where: joint or body; None for the robot.
        size: s, rad or the logarithm of a factor; its sign is the direction.
        base: the robot.
        model: the model that the simulator has.

    Raises:
        Sim2RealError: an effect that cannot be hidden in real logs.
    """
    right = base.known
    match effect:
        case "observation_delay":
            return Lie(abs(size), right, delay=abs(size))
        case "encoder_offset" if where:
            return Lie(size, right, offset=(where, size))
        case "position_gain":
            factor = {(effect, where): math.exp(size)}
            wrong = [(name, at, v * factor.get((name, at), 1.0)) for name, at, v in right]
            return Lie(math.exp(-size), wrong)
        case "link_mass" if where:
            more = float(model.body(where).mass[0]) * (math.exp(size) - 1)
            return Lie(-more, right, mass=(where, more))
        case "coulomb_friction":
            taken = [entry for entry in right if entry[:2] != (effect, where)]
            (value,) = [v for n, j, v in right if (n, j) == (effect, where)]
            return Lie(value, taken)
    raise Sim2RealError(
        f"{effect} cannot be hidden in real logs; available: {', '.join(base.where)}"
    )


def keep_joints(path: Path, joints: Sequence[str]) -> mujoco.MjSpec:
    """Return a model with these joints alone; others are fixed, with their actuators gone."""
    spec = mujoco.MjSpec.from_file(str(path))
    for actuator in list(spec.actuators):
        if actuator.target not in joints:
            spec.delete(actuator)
    for joint in list(spec.joints):
        if joint.name not in joints:
            spec.delete(joint)
    for key in list(spec.keys):
        spec.delete(key)
    return spec


def shortened(log: Log, joints: Sequence[str]) -> Log:
    """Return the first half minute of a log, with the columns of these joints."""
    rows = log.time <= log.time[0] + PART
    kinds = ("ctrl", "qpos", "qvel", "torque")
    kept = {"episode", "time", *(f"{kind}.{joint}" for kind in kinds for joint in joints)}
    columns = {name: values[rows] for name, values in log.columns.items() if name in kept}
    return Log(columns, log.meta, log.path)


def _effects(entries: Sequence[tuple[str, str, float]]) -> list[tuple[Effect, tuple[float, ...]]]:
    return [(make(name, where=joint), (value,)) for name, joint, value in entries]
