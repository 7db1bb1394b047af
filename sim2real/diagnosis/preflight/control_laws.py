"""A servo's own control law, as columns of its duty and of its torque tell it.

    findings = [*check_duties(pairs), *check_torques(pairs)]

A duty (PWM) tells without a simulation which gain the firmware applies. Columns that contradict
each other in it (a sign, a unit, a zero) are mistakes in the log, which the diagnosis names.

Drivers without a current sensor, and simulators, log kp (command - position) - kd speed under the
name of a torque. Such a column repeats what the others say: it is no evidence of what the motor
did, and no residual of it is shown. A measured one has noise of its own, which no law explains.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from envs.replay.recording import ROUNDING
from hardware.formats.names import IMPEDANCE_KINDS
from hardware.log import Log
from sim2real.diagnosis.data.pairs import TWELVE_BITS, Pairs, actuators_of, commands_of
from sim2real.diagnosis.data.recording import powered
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY, Preflight, Settings

CURRENT_BASED, FULL_PWM = 5, 885.0  # Dynamixel X e-manual: operating mode, PWM at full duty
DUTY = ("duty", "pwm")  # how columns of a duty are named
MEASURED = ("torque", "effort", "current")  # columns of a torque; a servo's load is its duty


def check_duties(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield a finding for each position servo whose gain is not the model's."""
    low, high = settings.preflight.ratio
    for name in actuators_of(pairs):
        rows = []
        for log, model, index, joint in commands_of(pairs, name):
            kp, stiffness = model.actuator_gainprm[index, 0], model.actuator_biasprm[index, 1]
            gain = _duty_gain(log, name, joint, settings.preflight)
            if gain is not None and model.actuator_forcelimited[index] and kp and stiffness:
                rows.append((log, gain, float(kp / model.actuator_forcerange[index, 1])))
        ratios = [gain / slope for _, gain, slope in rows]
        if not ratios or low < (ratio := float(np.median(ratios))) < high:
            continue
        log, gain, slope = rows[len(rows) // 2]
        text = (
            f"The duty of {name} grows by {gain:.3g} of full for each rad of error, the model's "
            f"by {slope:.3g} (kp / forcerange): the real gain is {ratio:.2f} of the model's "
            f"({len(ratios)} logs, {min(ratios):.2f} to {max(ratios):.2f})."
        )
        register = log.settings.get(name, {}).get("position_p_gain")
        if register:
            divisor = register / TWELVE_BITS / FULL_PWM / gain
            means = f"means a divisor of about {divisor:.0f}"
            text += f" A P gain register of {register:g} then {means}."
        fix = f"Multiply the model's kp by {ratio:.2f} (effect position_gain)."
        yield Finding("control_law", name, text, fix)


def check_torques(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield a finding for each actuator's column of torque that its other columns explain."""
    for name, column in _computed_torques(pairs, settings.preflight).items():
        yield Finding(
            "computed_torque",
            name,
            f"`{column}` is the law of {name} to the last digits: it was computed from the command "
            "and the position, not measured.",
            "Nothing to mend; it is not used as evidence. Log the motor's current if the driver "
            "reads it.",
        )


def measured_torques(pairs: Pairs, settings: Preflight = DEFAULT.preflight) -> dict[str, str]:
    """Return the column of each actuator's torque or current that is evidence: signed, measured."""
    computed, found = _computed_torques(pairs, settings), {}
    for log, _ in pairs:
        for name in log.actuators:
            column = _torque(log, name)
            if column is not None and name not in computed and log.column(column).min() < 0:
                found.setdefault(name, column)
    return found


def _computed_torques(pairs: Pairs, settings: Preflight) -> dict[str, str]:
    """Return the column of each actuator's torque that was computed in every log that has it."""
    found = {}
    for name in actuators_of(pairs):
        logs = [(log, joint, _torque(log, name)) for log, _, _, joint in commands_of(pairs, name)]
        own = [(log, joint, column) for log, joint, column in logs if column is not None]
        if own and all(_is_law(name, settings, *one) for one in own):
            found[name] = own[0][2]
    return found


def _torque(log: Log, actuator: str) -> str | None:
    """Return the column that calls itself an actuator's torque or current; None: there is none."""
    kinds = [f"sensor.{kind}{sign}{actuator}" for kind in MEASURED for sign in "_."]
    return _first(log, [f"current.{actuator}", *kinds])


def _first(log: Log, names: Iterable[str]) -> str | None:
    return next((name for name in names if name in log.columns), None)


def _is_law(actuator: str, settings: Preflight, log: Log, joint: str, column: str) -> bool:
    """Return whether command, position and speed of the same rows leave nothing of a column."""
    wanted = log.column(column)
    if wanted.min() >= 0 or np.ptp(wanted) < TINY or len(log) < settings.rows_min:
        return False
    free = (wanted > wanted.min()) & (wanted < wanted.max())  # within what may be its limits
    ctrl, q = log.column(f"ctrl.{actuator}"), log.column(f"qpos.{joint}")
    slopes = [np.gradient(part.column(f"qpos.{joint}"), part.time) for part in log.episodes()]
    speed = log.columns.get(f"qvel.{joint}", np.concatenate(slopes))
    none = np.zeros(len(log))
    kp, kd, wish, ahead = (log.columns.get(f"{k}.{actuator}", none) for k in IMPEDANCE_KINDS)
    terms = [ctrl, q, speed]
    if f"kp.{actuator}" in log.columns:
        terms = [kp * (ctrl - q), kd * (wish - speed), ahead]
    _, rest = _fit([term[free] for term in terms], wanted[free])
    return float(rest.std()) < settings.computed * float(wanted[free].std())


def _duty_gain(log: Log, actuator: str, joint: str, limits: Preflight) -> float | None:
    """Return how much of full a servo's duty grows for each unit of its error [1/rad].

    None where no duty is logged, where it does not follow command and position alike, and where
    the servo limits its current, which says nothing of the full duty.
    """
    names = [f"sensor.{kind}_{actuator}" for kind in DUTY]
    names += [f"sensor.{kind}" for kind in DUTY] if len(log.actuators) == 1 else []
    found, mode = _first(log, names), log.settings.get(actuator, {}).get("operating_mode")
    if found is None or mode == CURRENT_BASED:
        return None
    duty, on = log.column(found), powered(log, actuator)
    in_register = np.abs(duty).max() > np.sqrt(FULL_PWM)  # a share of full is at most 1
    duty = duty / (FULL_PWM if in_register else 1.0)
    free = on & np.roll(on, 1) & (duty > duty.min()) & (duty < duty.max())  # not at its limits
    y, q = duty[free], log.column(f"qpos.{joint}")[free]
    if len(y) < limits.rows_min:
        return None
    step = float(np.median(np.diff(log.time)))
    lags = np.arange(step / 2, limits.reach_s, step)  # between rows, which are not quite regular
    fits = [_fit([_held(log, actuator, lag)[free], q], y) for lag in lags]
    (command, position, _), rest = min(fits, key=lambda fit: np.sum(fit[1] ** 2))
    most = limits.law_residual * np.sum((y - y.mean()) ** 2)
    if np.sum(rest**2) > most or 0 in (command, position):
        return None
    low, high = limits.ratio
    return float(command) if low < -position / command < high else None


def _fit(terms: list[np.ndarray], wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of terms (n,) and of a constant that sum up to a column, and the rest."""
    table = np.column_stack([*terms, np.ones(len(wanted))])
    weights = np.linalg.lstsq(table, wanted, rcond=None)[0]
    return weights, wanted - table @ weights


def _held(log: Log, actuator: str, lag: float) -> np.ndarray:
    """Return the command that was in force a while before each row's reading, (T,)."""
    found = []
    for part in log.episodes():
        rows = np.searchsorted(part.time, part.time - lag - ROUNDING, side="left") - 1
        found.append(part.column(f"ctrl.{actuator}")[np.maximum(rows, 0)])
    return np.concatenate(found)
