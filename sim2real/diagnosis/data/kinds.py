"""Commands that are of another kind than the model's actuators: torques for servos, or positions.

    refuse_kinds(log, spec)                 # raises with the actuators and what to do

A servo's joint follows its command, and a torque does not look like the position that it makes.
Both are only a suspicion: a log is refused where its replay fails as well, and where commands taken
for torques make a better one. That has to be better than one without commands, too: a robot that is
much slower than its model looks as if nothing moved it.
"""

import mujoco
import numpy as np

from envs.effects.places import joint_driven
from envs.effects.servo import is_linear, is_servo
from hardware.log import Log
from sim2real.diagnosis.data.impedance import impedance_of
from sim2real.diagnosis.data.trial import choose, trial
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings
from sim2real.runs.errors import Sim2RealError


def refuse_kinds(log: Log, spec: mujoco.MjSpec, settings: Settings = DEFAULT) -> None:
    """Raise Sim2RealError for commands that cannot be meant for the model's actuators.

    Args:
        log: a log that the model fits by name.
        spec: its model.
        settings: what is no doubt.
    """
    model, limits = spec.copy().compile(), settings.preflight
    joints = _joints(log, model)
    if not joints or impedance_of(log):
        return
    alike = {name: _likeness(log, name, joint, settings) for name, joint in joints.items()}
    servos = [is_servo(model, model.actuator(name).id) for name in joints]
    place, names = log.path or "the log", ", ".join(joints)
    if not any(servos) and all(one > limits.share for one in alike.values()):
        if _gap(log, spec, joints, settings) > limits.lost:
            raise Sim2RealError(
                f"{place}: the joints follow the commands of {names} like desired positions, but "
                f"the model has motors there, which take torques [N·m]: give a model with position "
                "actuators, or log the torques as `ctrl.*`"
            )
    elif all(servos) and all(one < limits.stranger for one in alike.values()):
        kinds = (spec, _motors(spec, joints, 1.0), _motors(spec, joints, 0.0))
        gap, other, none = (_gap(log, one, joints, settings) for one in kinds)
        if gap > limits.lost and other < limits.better * min(gap, none):
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
    pieces = choose([log], settings.preflight.brief_s, settings.simulation.pieces)
    paths = trial(spec, [piece.recording(model) for piece in pieces]) if pieces else []
    found = []
    for piece, path in zip(pieces, paths, strict=True):
        for joint in joints.values():
            off = path[:, int(model.joint(joint).qposadr[0])] - piece.log.column(f"qpos.{joint}")
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
