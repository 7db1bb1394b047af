"""What a log's channels say about themselves, before any simulation.

    findings = [finding for check in CHECKS for finding in check(pairs, settings)]

Each check compares logs with themselves, or with the numbers in their models: stamps with their
rate, speed with position, duty with the error that the servo saw.
"""

from collections.abc import Callable, Iterator

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from hardware.log import READING, Log
from sim2real.diagnosis.data.noise_floor import count_of
from sim2real.diagnosis.data.pairs import (
    TURN,
    Pairs,
    actuators_of,
    commands_of,
    driven_by,
    episodes_with,
    joints_of,
    name_of,
    unit_of,
    which,
)
from sim2real.diagnosis.data.windows import reversals
from sim2real.diagnosis.preflight.control_laws import check_duties, check_torques
from sim2real.diagnosis.preflight.speeds import check_speeds
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import Settings

MILLI = 1e-3
Check = Callable[[Pairs, Settings], Iterator[Finding]]


def _reading(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """What was mended when the logs were read."""
    fix = "No action needed if that is right; else mend the log."
    for log, _ in pairs:
        for note in log.meta.get(READING, ()):
            yield Finding("reading", None, f"{name_of(log)}: {note}.", fix)


def _rate(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Irregular stamps, gaps, and a rate other than the metadata say."""
    limits = settings.preflight
    uneven, gaps, wrong = [], [], []
    for log, _ in pairs:
        steps = np.concatenate([np.diff(part.time) for part in log.episodes()])
        middle = float(np.median(steps))
        usual = np.quantile(np.abs(steps - middle), 1 - settings.inference.level)
        if usual > limits.jitter * middle:
            uneven.append((log, f"{middle / MILLI:.3g} ms ± {steps.std() / MILLI:.2g} ms"))
        long = steps > 2 * (1 + limits.jitter) * middle
        if long.any():
            gaps.append((log, f"{int(long.sum())} of up to {steps.max():.3g} s"))
        said = log.meta.get("rate")
        if isinstance(said, int | float) and abs(middle * said - 1) > limits.rate_error:
            wrong.append((log, middle * said, said))
    if wrong:
        ratio, said = float(np.median([w[1] for w in wrong])), wrong[0][2]
        yield Finding(
            "rate",
            None,
            f"The metadata say {said:g} rows a second, the stamps {said / ratio:.4g}"
            f"{which(wrong, pairs)}.",
            f"If the stamps are wrong, multiply `time` by {1 / ratio:.4g}; else correct `rate`.",
        )
    if uneven:
        yield Finding(
            "jitter",
            None,
            f"The rows are unevenly spaced, {uneven[0][1]}{which(uneven, pairs)}.",
            "Replays use the stamps, so nothing is lost if they are true; else set the adapter's "
            "latency to 1 ms and log from a process of its own.",
        )
    if gaps:
        yield Finding(
            "gaps",
            None,
            f"Rows are missing: {gaps[0][1]}{which(gaps, pairs)}.",
            "Commands sent meanwhile are unknown: cut the log there into episodes.",
        )


def _loss(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Readings that were lost, or said twice while the joint moved."""
    limits, bus = settings.preflight, "the cable and the bus's load"
    for joint in joints_of(pairs):
        lost = rows = 0
        for log, _ in pairs:
            if f"qpos.{joint}" not in log.columns:
                continue
            count = max(count_of([log], joint, settings), limits.count_min)
            for part in log.episodes():
                steps = np.diff(part.column(f"qpos.{joint}"))
                before, same, after = steps[:-2], steps[1:-1] == 0, steps[2:]
                moving = np.minimum(np.abs(before), np.abs(after)) > limits.counts * count
                lost += int(np.sum(same & moving & (before * after > 0)))
                rows += len(part)
        if rows and lost / rows > limits.unreported:
            yield Finding(
                "packet_loss",
                joint,
                f"{lost / rows:.1%} of the readings of {joint} repeat the last one while it moves: "
                "answers were lost or read too late.",
                f"Look at {bus}; simulate it with the effect packet_loss.",
            )
    for log, _ in pairs:
        share = float(np.mean(~log.fresh))
        if share > limits.unreported:
            yield Finding(
                "packet_loss",
                None,
                f"{share:.1%} of the rows of {name_of(log)} lack a servo's answer (flag.fresh).",
                "No action needed where joints are read less often than commands are sent; else "
                f"look at {bus}; simulate it with the effect packet_loss.",
            )


def _excitation(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Joints that never moved enough, or never turned back."""
    limits = settings.preflight
    still: dict[str, float] = dict(zip(("rad", "m"), limits.still, strict=True))
    for joint in joints_of(pairs):
        paths = [p.column(f"qpos.{joint}") for p in episodes_with(pairs, f"qpos.{joint}")]
        moved, unit = max(float(np.ptp(q)) for q in paths), unit_of(pairs, joint)
        turns = sum(reversals(q, settings.windows.turn * moved) for q in paths)
        if moved < still[unit]:
            yield Finding(
                "excitation",
                joint,
                f"{joint} moved by {moved:.3g} {unit} in all logs: it cannot be diagnosed.",
                "Record motions of this joint: run=record motions=[ramp,chirp,steps].",
            )
        elif turns < limits.reversals_min:
            yield Finding(
                "reversals",
                joint,
                f"{joint} turned back {turns} times: friction, play and dead zones look alike.",
                "Record slow ramps with reversals: run=record motions=[ramp].",
            )


def _ranged(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Hinges that are logged far beyond their range: in which unit, only their user knows."""
    found: dict[str, str] = {}
    for log, model in pairs:
        for joint, limit in _ranges(model).items():
            q = log.columns.get(f"qpos.{joint}", np.zeros(1))
            if float(np.abs(q).max()) > limit + TURN / 2:  # any angle is nearer than that
                found[joint] = (
                    f"{joint} runs from {q.min():.4g} to {q.max():.4g}, and its range ends at "
                    f"{limit:.3g} rad"
                )
    if found:
        yield Finding(
            "range",
            next(iter(found)) if len(found) == 1 else None,
            "Positions are in another unit, or counted from elsewhere: "
            f"{'; '.join(found.values())}.",
            "Give them in rad; a columns.yaml next to the log says how: `unit: deg`, "
            "`unit: counts/4096` with `zero: 2048`, or a `scale` and an `offset` of your own "
            "(docs/reference/log_format.md).",
        )


def _ranges(model: mujoco.MjModel) -> dict[str, float]:
    """Return how far each hinge may be from zero, by itself, its commands or its servo [rad].

    A servo that nothing limits holds a position within a turn.
    """
    hinge, found = int(mujoco.mjtJoint.mjJNT_HINGE), {}
    for i in range(model.njnt):
        if model.jnt_type[i] == hinge and model.jnt_limited[i]:
            found[model.joint(i).name] = float(np.abs(model.jnt_range[i]).max())
    for i in range(model.nu):
        if not is_joint_servo(model, i):
            continue
        joint = model.joint(int(model.actuator_trnid[i, 0]))
        if joint.type[0] == hinge:
            limited = bool(model.actuator_ctrllimited[i])
            reach = float(np.abs(model.actuator_ctrlrange[i]).max()) if limited else TURN
            found.setdefault(joint.name, reach)
    return found


def _clamped(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Commands that the model clamps."""
    most = settings.preflight.unreported
    for name in actuators_of(pairs):
        outside, rows = 0, 0
        reach = (0.0, 0.0)
        for log, model, index, _ in commands_of(pairs, name):
            ctrl = log.column(f"ctrl.{name}")
            rows += len(ctrl)
            if model.actuator_ctrllimited[index]:
                low, high = reach = tuple(model.actuator_ctrlrange[index])
                slack = most * (high - low)
                outside += int(np.sum((ctrl < low - slack) | (ctrl > high + slack)))
        if rows and outside / rows > most:
            yield Finding(
                "ctrlrange",
                name,
                f"{outside / rows:.0%} of the commands of {name} are outside the model's ctrlrange "
                f"[{reach[0]:.3g}, {reach[1]:.3g}], and the engine clamps them.",
                "Widen the range, or look at the command's unit and zero.",
            )


def _resolution(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """The encoder's steps."""
    for joint in joints_of(pairs):
        step = count_of([log for log, _ in pairs], joint, settings)
        if step > 0:
            unit = unit_of(pairs, joint)
            turn = f", {TURN / step:.0f} to a turn" if unit == "rad" else ""
            yield Finding(
                "quantization",
                joint,
                f"The positions of {joint} come in steps of {step:.4g} {unit}{turn}.",
                f"No action needed; a policy that reads it needs quantization = {step:.4g} {unit}.",
            )


def _commands(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Actuators of logged joints whose commands were not logged."""
    missing: dict[tuple[str, str], list[tuple[Log]]] = {}
    for log, model in pairs:
        names = [model.actuator(i).name for i in range(model.nu)]
        for name in [name for name in names if name not in log.actuators]:
            driven = driven_by(model, name)
            if driven is not None and f"qpos.{driven[1]}" in log.columns:
                missing.setdefault((name, driven[1]), []).append((log,))
    for (name, joint), where in missing.items():
        yield Finding(
            "no_command",
            joint,
            f"There is no column `ctrl.{name}`{which(where, pairs)}: the simulation holds "
            f"{joint} where the model's keyframe has it, or at 0.",
            f"Log the command of {name} as `ctrl.{name}`; if the joint was free, log "
            f"`torque.{name}` = 0 and any command.",
        )


def _unsigned(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Currents that are never negative although the joints go both ways."""
    names = dict.fromkeys(name for log, _ in pairs for name in log.columns)
    found = []
    for name in [name for name in names if "current" in name.split("_")[0]]:
        own = [log.column(name) for log, _ in pairs if name in log.columns]
        if min(map(np.min, own)) >= 0 and max(map(np.ptp, own)) > 0:
            found.append(name)
    if found:
        yield Finding(
            "unsigned",
            None,
            f"{len(found)} columns of current (`{found[0]}`, …) are never negative: they are "
            "magnitudes without a direction.",
            "No action needed; they cannot serve as torques.",
        )


CHECKS: tuple[Check, ...] = (
    *(_reading, _rate, _loss, _excitation, check_duties, check_speeds),
    *(_ranged, _clamped, _commands, _resolution, _unsigned, check_torques),
)
