"""What actuators with a state remember at each row of a log: integrated speeds, filtered commands.

    logs = [with_states(log, model) for log in logs]        # columns act.<actuator>
    state_of(log, model)                                    # (na,) in the first row

No log has these columns; its commands imply them (MuJoCo, "Actuation model"):

* an integrator (`intvelocity`) adds commands up, from where it held its joint: act' = ctrl;
* a filter follows them: act' = (ctrl - act) / τ, from the first command on.

What depends on more than commands (muscles, DC motors, one's own) is refused by name.
"""

from dataclasses import replace

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.pairs import driven_by
from sim2real.diagnosis.data.poses import follow_couplings, home, positions
from sim2real.runs.errors import Sim2RealError

INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
FILTERS = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
NONE = int(mujoco.mjtDyn.mjDYN_NONE)


def with_states(log: Log, model: mujoco.MjModel) -> Log:
    """Return the log with the state of each actuator that has one in columns `act.<actuator>`.

    Raises:
        Sim2RealError: an actuator whose state a log does not imply.
    """
    columns = {
        name: np.concatenate([_path(part, model, i) for part in log.episodes()])
        for i, name in stateful(model).items()
    }
    return replace(log, columns={**log.columns, **columns}) if columns else log


def state_of(log: Log, model: mujoco.MjModel) -> np.ndarray | None:
    """Return the actuators' states in the first row, (na,); None where the model has none."""
    state, names = np.zeros(model.na), stateful(model)
    known = log if log.columns.keys() >= {*names.values()} else with_states(log, model)
    for i, name in names.items():
        state[int(model.actuator_actadr[i])] = known.column(name)[0]
    return state if names else None


def stateful(model: mujoco.MjModel) -> dict[int, str]:
    """Return the column of each actuator with a state that commands imply.

    Raises:
        Sim2RealError: an actuator with another state.
    """
    found = [i for i in range(model.nu) if model.actuator_dyntype[i] != NONE]
    for i in found:
        kind = mujoco.mjtDyn(int(model.actuator_dyntype[i])).name.removeprefix("mjDYN_").lower()
        if model.actuator_dyntype[i] not in (INTEGRATOR, *FILTERS) or model.actuator_actnum[i] != 1:
            raise Sim2RealError(
                f"the actuator {model.actuator(i).name!r} has a state ({kind}) that no log "
                f"contains; give a model without it, such as <position> or <motor>"
            )
    return {i: f"act.{model.actuator(i).name}" for i in found}


def _path(log: Log, model: mujoco.MjModel, index: int) -> np.ndarray:
    """Return the state of an actuator in each row of an episode, (T,)."""
    name, time = model.actuator(index).name, log.time
    ctrl = log.columns.get(f"ctrl.{name}", np.zeros(len(time)))
    if model.actuator_ctrllimited[index]:
        ctrl = np.clip(ctrl, *model.actuator_ctrlrange[index])
    low, high = -np.inf, np.inf
    if model.actuator_actlimited[index]:
        low, high = map(float, model.actuator_actrange[index])
    if model.actuator_dyntype[index] == INTEGRATOR:
        first, kept, added = _holding(log, model, index), np.ones(len(time) - 1), np.diff(time)
    else:
        kept = np.exp(-np.diff(time) / max(float(model.actuator_dynprm[index, 0]), mujoco.mjMINVAL))
        first, added = ctrl[0], 1 - kept
    path = [float(first)]
    for share, gain in zip(kept.tolist(), (added * ctrl[:-1]).tolist(), strict=True):
        path.append(min(max(share * path[-1] + gain, low), high))
    return np.array(path)


def _holding(log: Log, model: mujoco.MjModel, index: int) -> float:
    """Return the state with which an actuator holds its joint in the first pose of an episode.

    Its force g act + b0 + b1 length is then the torque of inverse dynamics at rest (MuJoCo,
    "Inverse dynamics"): a servo that carries a load stands ahead of its joint.
    """
    driven = driven_by(model, model.actuator(index).name)
    if driven is None or model.actuator_gainprm[index, 0] == 0:
        return 0.0
    data, joint, places = mujoco.MjData(model), model.joint(driven[1]), positions(log, model)
    data.qpos[:], _ = home(model)
    for name, place in places.items():
        data.qpos[place] = log.column(f"qpos.{name}")[0]
    data.qpos[:], _ = follow_couplings(model, data.qpos, data.qvel, places.values())
    mujoco.mj_inverse(model, data)
    gear, (still, slope, _) = model.actuator_gear[index, 0], model.actuator_biasprm[index, :3]
    load = data.qfrc_inverse[joint.dofadr[0]] / gear - still
    length = gear * data.qpos[joint.qposadr[0]]
    return float((load - slope * length) / model.actuator_gainprm[index, 0])
