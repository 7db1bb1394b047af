"""Logs that a diagnosis cannot use, each with the reason and what to do.

Commands may be of another kind than the model's actuators: torques for servos, or positions. A
servo's joint follows its command, and a torque does not look like the position that it makes. Both
are only a suspicion: a log is refused where its replay fails as well, and where commands taken for
torques make a better one. That has to be better than one without commands, too: a robot that is
much slower than its model looks as if nothing moved it.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from envs.effects.places import joint_driven
from envs.effects.servo import is_linear, is_servo
from envs.models import FREE, columns_of
from hardware.log import Log
from sim2real.diagnosis.data.impedance import impedance_of
from sim2real.diagnosis.data.pairs import carriers
from sim2real.diagnosis.data.trial import choose, trial
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings
from sim2real.runs.errors import Sim2RealError

THOUSAND = 1000.0  # milliseconds in a second


def refuse_loose_base(log: Log, model: mujoco.MjModel, joints: Sequence[str]) -> None:
    """Raise Sim2RealError for a base that moves freely, carries compared joints and is not logged.

    A replay would start it at rest in its keyframe, in the middle of whatever it did.
    """
    bodies = [int(model.jnt_bodyid[model.joint(name).id]) for name in joints]
    above = {b for body in bodies for b in carriers(model, body)}
    for i in np.flatnonzero(model.jnt_type == FREE).tolist():
        body = int(model.jnt_bodyid[i])
        columns = [f"qpos.{name}" for name in columns_of(model, i)[0]]
        missing = [column for column in columns if column not in log.columns]
        if missing and body in above:
            name = model.joint(i).name or model.body(body).name
            raise Sim2RealError(
                f"{log.path or 'the log'}: the model's base {name!r} is free, and `{missing[0]}` "
                f"is not logged: its initial pose in each piece of the recording is unknown. Log "
                f"`{columns[0]}` to `{columns[-1]}` (motion capture, an estimator), and `qvel` if "
                "you can; or hold the base still while you record, and give a model whose base is "
                "fixed"
            )


def refuse_clock(log: Log, settings: Settings = DEFAULT) -> None:
    """Raise Sim2RealError for a log whose `time` can be no seconds: a replay would take hours.

    Nor may an episode last far longer than its rows do: whatever runs along the time of a log takes
    memory in proportion to its length, so that is at most `sparse` times what the rows take.
    """
    limits, place = settings.preflight, log.path or "the log"
    step = float(np.median(np.concatenate([np.diff(part.time) for part in log.episodes()])))
    least, most = limits.row_s
    if not least <= step <= most:
        factor = THOUSAND if step < least else 1 / THOUSAND
        raise Sim2RealError(
            f"{place}: its rows are {step:.4g} s apart, not {least:g} to {most:g} s; convert "
            f"`time` to seconds, for example multiply it by {factor:g}"
        )
    for part in log.episodes():
        steps = np.diff(part.time)
        usual, row = float(np.median(steps)), int(np.argmax(steps)) + 1
        if steps.sum() > limits.sparse * usual * len(part):
            raise Sim2RealError(
                f"{place}, episode {part.episode[0]}: row {row} is {steps[row - 1]:.4g} s after "
                f"the one before, where {usual:.3g} s are usual; correct its `time`, or begin "
                "another episode there"
            )


def refuse_kinds(log: Log, spec: mujoco.MjSpec, settings: Settings = DEFAULT) -> None:
    """Raise Sim2RealError for commands that cannot be meant for the model's actuators."""
    model, limits = spec.copy().compile(), settings.preflight
    joints = _joints(log, model)
    if not joints or impedance_of(log):
        return
    alike = {name: _likeness(log, name, joint, settings) for name, joint in joints.items()}
    servos = [is_servo(model, model.actuator(name).id) for name in joints]
    place, names = log.path or "the log", ", ".join(joints)
    if not any(servos) and all(one > limits.follows for one in alike.values()):
        if _gap(log, spec, joints, settings) ** 2 > 1 - limits.share:
            raise Sim2RealError(
                f"{place}: the joints follow the commands of {names} like desired positions, but "
                f"the model has motors there, which take torques [N·m]: give a model with position "
                "actuators, or log the torques as `ctrl.*`"
            )
    elif all(servos) and all(one < limits.follows for one in alike.values()):
        kinds = (spec, _motors(spec, joints, 1.0), _motors(spec, joints, 0.0))
        gap, other, none = (_gap(log, one, joints, settings) for one in kinds)
        if gap**2 > 1 - limits.share and other < limits.better * min(gap, none):
            raise Sim2RealError(
                f"{place}: the model has position servos at {names}, which take desired "
                "positions, but the commands act like torques: as such their replay is "
                f"{gap / other:.0f} times closer. Give a model with motors; a desired position "
                "with gains of its own needs `kp.<actuator>` as well"
            )


def _joints(log: Log, model: mujoco.MjModel) -> dict[str, str]:
    """Return the joint of each actuator that was commanded, where both are logged and affine."""
    found = {}
    for i in range(model.nactuator):
        name = model.actuator(i).name
        if name in log.actuators and joint_driven(model, i) and is_linear(model, i):
            joint = model.joint(int(model.actuator_trnid[i, 0])).name
            if f"qpos.{joint}" in log.columns and np.ptp(log.column(f"ctrl.{name}")) > 0:
                found[name] = joint
    return found


def _likeness(log: Log, actuator: str, joint: str, settings: Settings) -> float:
    """Return how well a joint's position is its command of a moment ago; 1: to the last digit."""
    best, q = -np.inf, log.column(f"qpos.{joint}")
    spread, step = max(float(q.std()), TINY), float(np.median(np.diff(log.time)))
    episodes = [(p.column(f"ctrl.{actuator}"), p.column(f"qpos.{joint}")) for p in log.episodes()]
    for rows in range(max(round(settings.preflight.reach_s / step), 1)):
        off = np.concatenate(
            [said[rows:] - sent[: max(len(sent) - rows, 0)] for sent, said in episodes]
        )
        if 2 * len(off) < len(q):
            break  # few rows are alike by chance
        best = max(best, 1.0 - float(off.std()) / spread)
    return best


def _gap(log: Log, spec: mujoco.MjSpec, joints: dict[str, str], settings: Settings) -> float:
    """Return how far a replay of short pieces is from the log, over the joints' spread."""
    model, most = spec.copy().compile(), settings.simulation.error_max
    pieces = choose([log], settings.windows.state_s)
    paths = trial(spec, [piece.recording(model) for piece in pieces])
    found = []
    for piece, path in zip(pieces, paths, strict=True):
        for joint in joints.values():
            off = path[:, int(model.joint(joint).qposadr[0])] - piece.column(f"qpos.{joint}")
            spread = max(float(log.column(f"qpos.{joint}").std()), TINY)
            sizes = np.fmin(np.abs(off) / spread, most)  # NaN: it diverged
            found.append(float(np.sqrt(np.mean(sizes**2))))
    return float(np.median(found)) if found else 0.0


def _motors(spec: mujoco.MjSpec, names: dict[str, str], gain: float) -> mujoco.MjSpec:
    """Return the spec with current-controlled motors, without back-EMF, in place of its servos."""
    spec = spec.copy()
    for actuator in spec.actuators:
        if actuator.name in names:
            actuator.biastype = mujoco.mjtBias.mjBIAS_NONE
            actuator.gainprm = [gain, *[0.0] * (mujoco.mjNGAIN - 1)]
            actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
            actuator.damping = np.zeros_like(np.asarray(actuator.damping))
    return spec
