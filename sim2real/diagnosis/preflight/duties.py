"""Duty or PWM against command and position: the gain of the servo's own control law.

    findings = check_duties(pairs)

The register tells without a simulation which gain the firmware applies. Columns that contradict
each other in it (a sign, a unit, a zero) are mistakes in the log, which the diagnosis names.
"""

from collections.abc import Iterator

import numpy as np

from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.pairs import TWELVE_BITS, Pairs, actuators_of, commands_of
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings

CURRENT_BASED, FULL_PWM = 5, 885.0  # Dynamixel X e-manual: operating mode, PWM at full duty


def check_duties(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield a finding for each position servo whose gain is not the model's."""
    low, high = settings.preflight.ratio
    for name in actuators_of(pairs):
        rows = []
        for log, model, index, joint in commands_of(pairs, name):
            kp, stiffness = model.actuator_gainprm[index, 0], model.actuator_biasprm[index, 1]
            gain = _duty_gain(log, name, joint, settings)
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


def _duty_gain(log: Log, actuator: str, joint: str, settings: Settings) -> float | None:
    """Return how much of full a servo's duty grows for each unit of its error [1/rad].

    None where no duty is logged, where it does not follow command and position alike, and where
    the servo limits its current, which says nothing of the full duty.
    """
    names = [f"sensor.duty_{actuator}", f"sensor.pwm_{actuator}"]
    names += ["sensor.duty", "sensor.pwm"] if len(log.actuators) == 1 else []
    found = next((name for name in names if name in log.columns), None)
    mode = log.settings.get(actuator, {}).get("operating_mode")
    if found is None or mode == CURRENT_BASED:
        return None
    duty, limits = log.column(found), settings.preflight
    in_register = np.abs(duty).max() > np.sqrt(FULL_PWM)  # a share of full is at most 1
    duty = duty / (FULL_PWM if in_register else 1.0)
    on = log.columns.get(f"torque.{actuator}", np.ones(len(log))) > 0
    free = on & np.roll(on, 1) & (np.abs(duty) < limits.saturated)
    y, q = duty[free], log.column(f"qpos.{joint}")[free]
    if len(y) < limits.rows_min:
        return None
    fits = []
    for lag in np.arange(0.0, limits.reach_s, float(np.median(np.diff(log.time)))):
        table = np.column_stack([_held(log, actuator, lag)[free], q, np.ones(len(y))])
        law = np.linalg.lstsq(table, y, rcond=None)[0]
        fits.append((float(np.sum((y - table @ law) ** 2)), law))
    rest, (command, position, _) = min(fits, key=lambda fit: fit[0])
    if rest > limits.law_residual * np.sum((y - y.mean()) ** 2) or 0 in (command, position):
        return None
    low, high = limits.ratio
    return float(command) if low < -position / command < high else None


def _held(log: Log, actuator: str, lag: float) -> np.ndarray:
    """The command that was in force a while before each row's reading, (T,)."""
    found = []
    for part in log.episodes():
        rows = np.searchsorted(part.time, part.time - lag - ROUNDING, side="left") - 1
        found.append(part.column(f"ctrl.{actuator}")[np.maximum(rows, 0)])
    return np.concatenate(found)
