"""Speed and duty registers against the positions and commands that they should follow.

    laws = speed_laws(pairs)            # by joint: scale, lag
    duty_law(log, model, "elbow")       # what drives a servo's duty

They settle without a simulation what replays can only suggest: a flipped sign, a unit, a zero, a
rate, and the gain of the servo's own control law.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.ndimage import uniform_filter1d

from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs, index_of, joints_of
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Servo, Settings

DEGREES = 180 / np.pi
CURRENT_BASED = 5  # the operating mode of Dynamixel X servos; its manual


class Law(NamedTuple):
    """A channel as a multiple of what it should follow."""

    scale: float
    lag: float  # s
    share: float  # of its variance that this explains


def check_speeds(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Speed registers against the slope of the positions."""
    limits = settings.servo
    laws = speed_laws(pairs, limits)
    ratios = {joint: law.scale for joint, law in laws.items()}
    wrong = {joint: a for joint, a in ratios.items() if not _within(a, limits.speed_ratio)}
    common = float(np.median(list(ratios.values()))) if ratios else 1.0
    alike = np.ptp([*ratios.values(), common]) < limits.common_spread * abs(common)
    whole = len(wrong) == len(ratios) > 0 and alike
    if whole and common > 0 and not _is_degrees(common, limits):
        yield Finding(
            "rate",
            None,
            f"The speeds are {common:.3g} times the change of the positions over time, for every "
            "joint alike: the stamps run at a wrong rate, or the speeds have a wrong unit.",
            f"If the stamps are wrong, multiply `time` by {1 / common:.4g}; if the speeds are, "
            f"divide `qvel` by {common:.4g}.",
        )
        return
    for joint, scale in wrong.items():
        yield _speed_finding(joint, scale, limits)
    for joint, law in laws.items():
        if joint not in wrong and law.lag > limits.lag_s:
            yield Finding(
                "velocity_filter",
                joint,
                f"The speed of {joint} comes {1e3 * law.lag:.0f} ms after its position.",
                f"No action needed; a policy that reads it needs velocity_filter={law.lag:.3f} s.",
            )


def _within(value: float, ends: tuple[float, float]) -> bool:
    return ends[0] < value < ends[1]


def _is_degrees(scale: float, settings: Servo) -> bool:
    size = abs(scale)
    return any(_within(size * f, settings.speed_ratio) for f in (DEGREES, 1 / DEGREES))


def _speed_finding(joint: str, scale: float, settings: Servo) -> Finding:
    if _is_degrees(scale, settings):
        which, other = ("qpos", "qvel") if abs(scale) < 1 else ("qvel", "qpos")
        return Finding(
            "degrees",
            joint,
            f"`{which}.{joint}` is in degrees and `{other}.{joint}` in rad: their ratio is "
            f"{scale:.3g}.",
            f"Multiply `{which}.{joint}` by pi/180 (and look at its command).",
        )
    if _within(-scale, settings.speed_ratio):
        return Finding(
            "speed",
            joint,
            f"`qvel.{joint}` is positive where `qpos.{joint}` falls: one of them has its sign "
            "flipped.",
            f"Negate `qvel.{joint}`, or `qpos.{joint}` if the replay is better then.",
        )
    return Finding(
        "speed",
        joint,
        f"The speed of {joint} is {scale:.3g} times the change of its position over time.",
        f"Divide `qvel.{joint}` by {scale:.4g}, or correct the scale of its position.",
    )


def speed_laws(pairs: Pairs, settings: Servo = DEFAULT.servo) -> dict[str, Law]:
    """Return how the speed register of each joint follows d(position)/dt, where it does."""
    found = {}
    for joint in joints_of(pairs):
        names = f"qpos.{joint}", f"qvel.{joint}"
        slopes, speeds, steps = [], [], []
        for log, _ in pairs:
            if not all(name in log.columns for name in names):
                continue
            for part in log.episodes():
                if len(part) > settings.speed_rows_min:
                    q, v, dt = _uniform(part, *names, settings)
                    slopes.append(np.gradient(q, dt))
                    speeds.append(v)
                    steps.append(dt)
        if slopes:
            law = _follow(slopes, speeds, steps, settings)
            if law.share > settings.speed_share:
                found[joint] = law
    return found


def _uniform(
    part: Log, position: str, speed: str, settings: Servo
) -> tuple[np.ndarray, np.ndarray, float]:
    """Both channels on an even clock, averaged over the same window, and its step."""
    dt = float(np.median(np.diff(part.time)))
    clock = np.arange(part.time[0], part.time[-1], dt)
    stamps = part.columns.get(f"stamp.{position.removeprefix('qpos.')}", part.time)
    width = max(settings.smoothing_rows_min, round(settings.smoothing_s / dt)) | 1
    return (
        uniform_filter1d(np.interp(clock, stamps, part.column(position)), width, mode="nearest"),
        uniform_filter1d(np.interp(clock, stamps, part.column(speed)), width, mode="nearest"),
        dt,
    )


def _follow(
    slopes: Sequence[np.ndarray],
    speeds: Sequence[np.ndarray],
    steps: Sequence[float],
    settings: Servo,
) -> Law:
    """Fit speed = scale * slope(t - lag)."""
    best = Law(1.0, 0.0, -np.inf)
    total = sum(float(np.sum(v**2)) for v in speeds)
    if total == 0:
        return best
    for lag in np.arange(*settings.lags_s):
        late = [
            np.interp(np.arange(len(s)) - lag / dt, np.arange(len(s)), s)
            for s, dt in zip(slopes, steps, strict=True)
        ]
        power = sum(float(np.sum(s**2)) for s in late)
        shared = sum(float(s @ v) for s, v in zip(late, speeds, strict=True))
        share = shared**2 / max(power * total, TINY_SQUARE)
        if share > best.share:
            best = Law(shared / max(power, TINY_SQUARE), float(lag), share)
    return best


class DutyLaw(NamedTuple):
    """What drives a servo's duty: duty = command * ctrl + position * (qpos - zero)."""

    command: float  # of full, 1/rad
    position: float  # of full, 1/rad; minus `command` where nothing is wrong
    zero: float  # rad that the positions read more than the commands mean


def check_duties(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """PWM against command and position, by the gain and the force range of the model."""
    limits = settings.servo
    for name in dict.fromkeys(name for log, _ in pairs for name in log.actuators):
        laws = [(log, model, duty_law(log, model, name, limits)) for log, model in pairs]
        known = [(log, model, law) for log, model, law in laws if law is not None]
        if not known:
            continue
        command, position, zero = np.median([law for *_, law in known], axis=0).tolist()
        joint = known[0][1].joint(int(known[0][1].actuator(name).trnid[0])).name
        mismatch = -position / command
        if command < 0 or position > 0:
            yield _law_sign(name, joint, command, position)
        elif not _within(mismatch, limits.unit_ratio):
            yield _law_scale(name, joint, mismatch, limits)
        elif abs(zero) > limits.zero:
            yield Finding(
                "zero",
                joint,
                f"The duty of {name} vanishes where `qpos.{joint}` reads {zero:.3f} more than the "
                f"command: the log's positions have another zero than the servo's own.",
                f"Subtract {zero:.3f} from `qpos.{joint}`; as an effect this is encoder_offset = "
                f"{zero:.3f} with servo = 0.",
            )
        else:
            yield from _law_gain(name, known, limits)


def _law_sign(name: str, joint: str, command: float, position: float) -> Finding:
    flipped = [f"`ctrl.{name}`"] if command < 0 else []
    flipped += [f"`qpos.{joint}`"] if position > 0 else []
    both = command < 0 < position
    verb = "count" if both else "counts"
    text = f"The servo's duty shows that {' and '.join(flipped)} {verb} against the servo's torque"
    if both:
        text += " (or that the logged duty has another sign)"
    fix = f"Negate {' and '.join(flipped)}, or correct the servo's `sign`."
    return Finding("sign", joint, f"{text}.", fix)


def _law_scale(name: str, joint: str, mismatch: float, settings: Servo) -> Finding:
    text = (
        f"A rad of `qpos.{joint}` changes the duty of {name} {mismatch:.3g} times as much as a rad "
        "of its command"
    )
    if _is_degrees(mismatch, settings):
        column = f"qpos.{joint}" if mismatch < 1 else f"ctrl.{name}"
        return Finding(
            "degrees",
            joint,
            f"{text}: `{column}` is in degrees.",
            f"Multiply `{column}` by pi/180.",
        )
    fix = f"Correct the scale of `qpos.{joint}` or of `ctrl.{name}`."
    return Finding("scale", joint, f"{text}: they have different units.", fix)


def _law_gain(
    name: str, known: Sequence[tuple[Log, mujoco.MjModel, DutyLaw]], settings: Servo
) -> Iterator[Finding]:
    """A gain that is not the model's; a limit of current says nothing of the full duty."""
    rows = [(log, law, slope) for log, m, law in known if (slope := model_slope(m, name))]
    rows = [row for row in rows if not _limits_current(row[0], name)]
    ratios = [law.command / slope for _, law, slope in rows]
    if not ratios or _within(float(np.median(ratios)), settings.gain_ratio):
        return
    ratio, (log, law, slope) = float(np.median(ratios)), rows[len(rows) // 2]
    text = (
        f"The duty of {name} grows by {law.command:.3g} of full for each rad of error, the model's "
        f"by {slope:.3g} (kp / forcerange): the real gain is {ratio:.2f} of the model's"
    )
    text += f" ({len(ratios)} logs, {min(ratios):.2f} to {max(ratios):.2f})."
    gain = log.settings.get(name, {}).get("position_p_gain")
    if gain:
        divisor = gain * settings.turn_counts / settings.full_pwm / law.command
        text += f" A P gain register of {gain:g} then means a divisor of about {divisor:.0f}."
    fix = f"Multiply the model's kp by {ratio:.2f} (effect position_gain)."
    yield Finding("control_law", name, text, fix)


def duty_law(
    log: Log, model: mujoco.MjModel, actuator: str, settings: Servo = DEFAULT.servo
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
    duty = log.column(found)
    duty = duty / (settings.full_pwm if np.abs(duty).max() > settings.duty_share_max else 1.0)
    on = log.columns.get(f"torque.{actuator}", np.ones(len(log))) > 0
    free = on & np.roll(on, 1) & (np.abs(duty) < settings.saturated_duty)
    y, q = duty[free], log.column(f"qpos.{joint}")[free]
    fits = []
    for lag in np.arange(0.0, *settings.delays_s):
        sent = _held(log, actuator, lag)[free]
        moves = min(sent.std(), q.std()) > settings.motion_min
        if len(y) >= settings.duty_rows_min and moves:
            table = np.column_stack([sent, q, np.ones(len(y))])
            law = np.linalg.lstsq(table, y, rcond=None)[0]
            fits.append((float(np.sum((y - table @ law) ** 2)), law))
    if not fits:
        return None
    rest, (command, position, constant) = min(fits, key=lambda fit: fit[0])
    if rest > settings.law_residual * np.sum((y - y.mean()) ** 2) or 0 in (command, position):
        return None
    return DutyLaw(float(command), float(position), float(-constant / position))


def _held(log: Log, actuator: str, lag: float) -> np.ndarray:
    """The command that was in force a while before each row's reading, (T,)."""
    found = []
    for part in log.episodes():
        rows = np.searchsorted(part.time, part.time - lag - ROUNDING, side="left") - 1
        found.append(part.column(f"ctrl.{actuator}")[np.maximum(rows, 0)])
    return np.concatenate(found)


def _limits_current(log: Log, actuator: str) -> bool:
    """Return whether a servo was in current-based position mode: its current has a limit."""
    return log.settings.get(actuator, {}).get("operating_mode") == CURRENT_BASED


def model_slope(model: mujoco.MjModel, actuator: str) -> float | None:
    """Return by how much of the largest force the model's actuator grows for each rad of error."""
    index = index_of(model, actuator)
    if index is None or not model.actuator_forcelimited[index]:
        return None
    return float(model.actuator_gainprm[index, 0] / model.actuator_forcerange[index, 1])
