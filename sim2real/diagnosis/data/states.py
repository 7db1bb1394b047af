"""What actuators with a state remember at each row of a log: integrated speeds, filtered commands.

    logs = [with_states(log, model) for log in logs]        # columns act.<actuator>
    state_of(log, model)                                    # (na,) in the first row

No log has these columns; its commands imply them (MuJoCo, "Actuation model"):

* an integrator (`intvelocity`) adds commands up, from where its joint stood: act' = ctrl;
* a filter follows them: act' = (ctrl - act) / τ, from the first command on.

What depends on more than commands (muscles, DC motors, one's own) is refused by name.
"""

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.pairs import driven_by
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
        name: np.concatenate([_path(part.columns, model, i) for part in log.episodes()])
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


def _path(columns: Mapping[str, np.ndarray], model: mujoco.MjModel, index: int) -> np.ndarray:
    """Return the state of an actuator in each row of an episode, (T,).

    An integrator begins at its joint's position, times its gear.
    """
    name, time = model.actuator(index).name, columns["time"]
    ctrl = columns.get(f"ctrl.{name}", np.zeros(len(time)))
    if model.actuator_ctrllimited[index]:
        ctrl = np.clip(ctrl, *model.actuator_ctrlrange[index])
    low, high = -np.inf, np.inf
    if model.actuator_actlimited[index]:
        low, high = map(float, model.actuator_actrange[index])
    if model.actuator_dyntype[index] == INTEGRATOR:
        driven, gear = driven_by(model, name), float(model.actuator_gear[index, 0])
        stands = columns.get(f"qpos.{driven[1]}", [0.0])[0] if driven else 0.0
        first, kept, added = gear * stands, np.ones(len(time) - 1), np.diff(time)
    else:
        kept = np.exp(-np.diff(time) / max(float(model.actuator_dynprm[index, 0]), mujoco.mjMINVAL))
        first, added = ctrl[0], 1 - kept
    path = [float(first)]
    for share, gain in zip(kept.tolist(), (added * ctrl[:-1]).tolist(), strict=True):
        path.append(min(max(share * path[-1] + gain, low), high))
    return np.array(path)
