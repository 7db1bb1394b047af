"""Duty or PWM against command and position: the gain of the servo's own control law.

    findings = check_duties(pairs)
    duty_law(log, model, "elbow")       # what drives a servo's duty

The register tells without a simulation which gain the firmware applies. Columns that contradict
each other in it (a sign, a unit, a zero) are mistakes of the log, which the diagnosis names.
"""

from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np

from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.pairs import TWELVE_BITS, Pairs, index_of
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings

CURRENT_BASED, FULL_PWM = 5, 885.0  # Dynamixel X e-manual: operating mode, PWM at full duty


class DutyLaw(NamedTuple):
    """What drives a servo's duty: duty = command * ctrl + position * qpos + a constant."""

    command: float  # of full, 1/rad
    position: float  # of full, 1/rad; minus `command` where nothing is wrong


def check_duties(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield a finding for each servo whose gain is not the model's."""
    low, high = settings.preflight.ratio
    for name in dict.fromkeys(name for log, _ in pairs for name in log.actuators):
        rows = []
        for log, model in pairs:
            if log.settings.get(name, {}).get("operating_mode") == CURRENT_BASED:
                continue  # a limit of current says nothing of the full duty
            law, slope = duty_law(log, model, name, settings), model_slope(model, name)
            if law is not None and slope and low < -law.position / law.command < high:
                rows.append((log, law, slope))
        ratios = [law.command / slope for _, law, slope in rows]
        if ratios and not low < float(np.median(ratios)) < high:
            log, law, slope = rows[len(rows) // 2]
            yield _finding(name, log, law, slope, ratios)


def _finding(name: str, log: Log, law: DutyLaw, slope: float, ratios: list[float]) -> Finding:
    ratio = float(np.median(ratios))
    text = (
        f"The duty of {name} grows by {law.command:.3g} of full for each rad of error, the model's "
        f"by {slope:.3g} (kp / forcerange): the real gain is {ratio:.2f} of the model's "
        f"({len(ratios)} logs, {min(ratios):.2f} to {max(ratios):.2f})."
    )
    gain = log.settings.get(name, {}).get("position_p_gain")
    if gain:
        divisor = gain / TWELVE_BITS / FULL_PWM / law.command
        text += f" A P gain register of {gain:g} then means a divisor of about {divisor:.0f}."
    fix = f"Multiply the model's kp by {ratio:.2f} (effect position_gain)."
    return Finding("control_law", name, text, fix)


def duty_law(
    log: Log, model: mujoco.MjModel, actuator: str, settings: Settings = DEFAULT
) -> DutyLaw | None:
    """Return how the duty of a servo follows its command and its position.

    None where no duty is logged, where it follows neither, and for a motor.
    """
    index = index_of(model, actuator)
    if index is None or model.actuator_biasprm[index, 1] == 0:  # none, or a motor's torque
        return None
    joint = model.joint(int(model.actuator_trnid[index, 0])).name
    names = [f"sensor.duty_{actuator}", f"sensor.pwm_{actuator}"]
    names += ["sensor.duty", "sensor.pwm"] if len(log.actuators) == 1 else []
    found = next((name for name in names if name in log.columns), None)
    if found is None or f"qpos.{joint}" not in log.columns:
        return None
    duty, limits = log.column(found), settings.preflight
    in_register = np.abs(duty).max() > np.sqrt(FULL_PWM)  # a share of full is at most 1
    duty = duty / (FULL_PWM if in_register else 1.0)
    on = log.columns.get(f"torque.{actuator}", np.ones(len(log))) > 0
    free = on & np.roll(on, 1) & (np.abs(duty) < limits.saturated)
    y, q = duty[free], log.column(f"qpos.{joint}")[free]
    fits = []
    for lag in np.arange(0.0, limits.reach_s, float(np.median(np.diff(log.time)))):
        sent = _held(log, actuator, lag)[free]
        if len(y) >= limits.rows_min:
            table = np.column_stack([sent, q, np.ones(len(y))])
            law = np.linalg.lstsq(table, y, rcond=None)[0]
            fits.append((float(np.sum((y - table @ law) ** 2)), law))
    if not fits:
        return None
    rest, (command, position, _) = min(fits, key=lambda fit: fit[0])
    if rest > limits.law_residual * np.sum((y - y.mean()) ** 2) or 0 in (command, position):
        return None
    return DutyLaw(float(command), float(position))


def _held(log: Log, actuator: str, lag: float) -> np.ndarray:
    """The command that was in force a while before each row's reading, (T,)."""
    found = []
    for part in log.episodes():
        rows = np.searchsorted(part.time, part.time - lag - ROUNDING, side="left") - 1
        found.append(part.column(f"ctrl.{actuator}")[np.maximum(rows, 0)])
    return np.concatenate(found)


def model_slope(model: mujoco.MjModel, actuator: str) -> float | None:
    """Return by how much of the largest force the model's actuator grows for each rad of error."""
    index = index_of(model, actuator)
    if index is None or not model.actuator_forcelimited[index]:
        return None
    return float(model.actuator_gainprm[index, 0] / model.actuator_forcerange[index, 1])
