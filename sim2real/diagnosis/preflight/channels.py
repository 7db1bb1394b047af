"""What a log's channels say about themselves, before any simulation.

    findings = check_channels(logs, models)

Each check compares a log with itself, or with the numbers in a model: stamps with their rate, speed
with position, duty with the error that the servo saw. A finding of `NOTES` describes what the
sensors are like; every other one should be corrected before a physical cause is sought.
"""

from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from hardware.log import READING, Log
from sim2real.diagnosis.data.noise_floor import count_of
from sim2real.diagnosis.data.pairs import TURN, Pairs, index_of, joints_of, name_of, unit_of, which
from sim2real.diagnosis.data.windows import reversals
from sim2real.diagnosis.preflight.duties import check_duties
from sim2real.diagnosis.preflight.speeds import check_speeds
from sim2real.diagnosis.preflight.torques import check_torques
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY, Settings

NOTES = frozenset(
    {
        "quantization",
        "noise",
        "velocity_filter",
        "unsigned",
        "computed_torque",
        "base",
        "reading",
    }
)
MILLI = 1e-3
Check = Callable[[Pairs, Settings], Iterator[Finding]]


def check_channels(
    logs: Sequence[Log], models: Sequence[mujoco.MjModel], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return what the channels of logs contradict.

    Args:
        logs: the logs.
        models: the model of each.
        settings: when they do.
    """
    pairs = list(zip(logs, models, strict=True))
    return [finding for check in CHECKS for finding in check(pairs, settings)]


def _reading(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """What was mended when the logs were read."""
    for log, _ in pairs:
        for note in log.meta.get(READING, ()):
            yield Finding(
                "reading",
                None,
                f"{name_of(log)}: {note}.",
                "No action needed if that is right; else mend the log.",
            )


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
        long = steps > limits.gap * middle
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
    limits = settings.preflight
    for joint in joints_of(pairs):
        lost = rows = 0
        for log, _ in pairs:
            column = f"qpos.{joint}"
            if column not in log.columns:
                continue
            step = max(count_of([log], joint, settings), limits.count_min)
            for part in log.episodes():
                q = part.column(column)
                if len(q) <= len(("before", "same", "after")):
                    continue
                same = q[1:-2] == q[2:-1]
                before, after = q[1:-2] - q[:-3], q[3:] - q[2:-1]
                moved = np.minimum(np.abs(before), np.abs(after))
                moving = moved > limits.counts * step
                lost += int(np.sum(same & moving & (before * after > 0)))
                rows += len(q)
        if rows and lost / rows > limits.lost_share:
            yield Finding(
                "packet_loss",
                joint,
                f"{lost / rows:.1%} of the readings of {joint} repeat the last one while it moves: "
                "answers were lost or read too late.",
                "Look at the cable and the bus's load; simulate it with the effect packet_loss.",
            )
    for log, _ in pairs:
        share = float(np.mean(~log.fresh))
        if share > limits.lost_share:
            yield Finding(
                "packet_loss",
                None,
                f"{share:.1%} of the rows of {name_of(log)} lack a servo's answer (flag.fresh).",
                "No action needed where joints are read less often than commands are sent; else "
                "look at the cable and the bus's load; simulate it with the effect packet_loss.",
            )


def _excitation(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Joints that never moved enough, or never turned back."""
    limits = settings.preflight
    still = {"rad": limits.still_rad, "m": limits.still_m}
    for joint, (moved, turns) in excitation(pairs, settings).items():
        unit = unit_of(pairs, joint)
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


def excitation(pairs: Pairs, settings: Settings = DEFAULT) -> dict[str, tuple[float, int]]:
    """Return by joint how far it moved [rad or m] and how often it turned back."""
    found = {}
    for joint in joints_of(pairs):
        parts = [
            part.column(f"qpos.{joint}")
            for log, _ in pairs
            if f"qpos.{joint}" in log.columns
            for part in log.episodes()
        ]
        moved = max(float(np.ptp(q)) for q in parts)
        size = settings.windows.turn * moved
        found[joint] = moved, sum(reversals(q, size) for q in parts)
    return found


def _ranged(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Hinges that are logged far beyond their range: in which unit, only their user knows."""
    found: dict[str, str] = {}
    for log, model in pairs:
        for joint, limit in _ranges(model).items():
            q = log.columns.get(f"qpos.{joint}", np.zeros(1))
            if float(np.abs(q).max()) > settings.preflight.beyond * limit:
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
    found = {}
    for i in range(model.njnt):
        if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE and model.jnt_limited[i]:
            found[model.joint(i).name] = float(np.abs(model.jnt_range[i]).max())
    for i in range(model.nu):
        if model.actuator_trntype[i] != mujoco.mjtTrn.mjTRN_JOINT or not is_joint_servo(model, i):
            continue
        joint = model.joint(int(model.actuator_trnid[i, 0]))
        if joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE:
            limited = bool(model.actuator_ctrllimited[i])
            reach = float(np.abs(model.actuator_ctrlrange[i]).max()) if limited else TURN
            found.setdefault(joint.name, reach)
    return found


def _limits(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Commands that the model clamps, and rows at its limit of force."""
    limits = settings.preflight
    for name in dict.fromkeys(name for log, _ in pairs for name in log.actuators):
        outside, held, rows, least = 0, 0, 0, []
        reach = (0.0, 0.0)
        for log, model in pairs:
            index = index_of(model, name)
            if index is None:
                continue
            ctrl = log.column(f"ctrl.{name}")
            rows += len(ctrl)
            if model.actuator_ctrllimited[index]:
                low, high = reach = tuple(model.actuator_ctrlrange[index])
                slack = limits.outside * (high - low)
                outside += int(np.sum((ctrl < low - slack) | (ctrl > high + slack)))
            force = _force(log, model, index)
            if force is not None and model.actuator_forcelimited[index]:
                size, most = np.abs(force), float(model.actuator_forcerange[index, 1])
                on = log.columns.get(f"torque.{name}", np.ones(len(log))) > 0
                held += int(np.sum(on & (size >= most)))
                often = float(np.quantile(size, 1 - limits.saturated_share))
                least += [min(most / max(often, TINY), 1.0)]
        if rows and outside / rows > limits.outside:
            yield Finding(
                "ctrlrange",
                name,
                f"{outside / rows:.0%} of the commands of {name} are outside the model's ctrlrange "
                f"[{reach[0]:.3g}, {reach[1]:.3g}], and the engine clamps them.",
                "Widen the range, or look at the command's unit and zero.",
            )
        if rows and held / rows > limits.saturated_share:
            yield Finding(
                "saturation",
                name,
                f"At the errors that the robot had, the model's {name} would be at its limit of "
                f"force in {held / rows:.0%} of the rows: the robot's gain is at most "
                f"{min(least):.2g} times the model's, or its gain does not show and its limit "
                "does.",
                "Compare the model's kp and forcerange with the servo's; record smaller motions.",
            )


def _force(log: Log, model: mujoco.MjModel, index: int) -> np.ndarray | None:
    """Return the least force of the model's position servo that a log's rows tell, (T,).

    A reading is taken between the command of the row before and that of its own, and at a speed
    between rest and the change of positions: a stiff servo that follows steps of its command rests
    between them. A speed's own column may have another unit. None: it is no position servo, or was
    not measured.
    """
    joint = model.joint(int(model.actuator_trnid[index, 0])).name
    gain, (_, stiff, damping) = model.actuator_gainprm[index, 0], model.actuator_biasprm[index, :3]
    if stiff == 0 or f"qpos.{joint}" not in log.columns:
        return None
    position, ctrl = log.column(f"qpos.{joint}"), log.column(f"ctrl.{model.actuator(index).name}")
    errors = ctrl - position, np.append(ctrl[:1], ctrl[:-1]) - position
    speeds = 0 * position, np.gradient(position, log.time)
    forces = np.array([gain * error + damping * speed for error in errors for speed in speeds])
    return np.maximum(forces.min(axis=0), 0.0) + np.minimum(forces.max(axis=0), 0.0)


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
    missing: dict[str, list[tuple]] = {}
    for log, model in pairs:
        for i in range(model.nu):
            name = model.actuator(i).name
            if index_of(model, name) is None or name in log.actuators:
                continue
            joint = model.joint(int(model.actuator_trnid[i, 0])).name
            if f"qpos.{joint}" in log.columns:
                missing.setdefault(name, []).append((log, joint))
    for name, where in missing.items():
        yield Finding(
            "no_command",
            where[0][1],
            f"There is no column `ctrl.{name}`{which(where, pairs)}: the simulation holds "
            f"{where[0][1]} where the model's keyframe has it, or at 0.",
            f"Log the command of {name} as `ctrl.{name}`; if the joint was free, log "
            f"`torque.{name}` = 0 and any command.",
        )


def _unsigned(pairs: Pairs, settings: Settings) -> Iterator[Finding]:
    """Currents that are never negative although the joints go both ways."""
    names = [n for log, _ in pairs for n in log.columns if "current" in n.split("_")[0]]
    positive = [
        name
        for name in dict.fromkeys(names)
        if all(log.columns[name].min() >= 0 for log, _ in pairs if name in log.columns)
        and any(log.columns[name].std() > 0 for log, _ in pairs if name in log.columns)
    ]
    if positive:
        yield Finding(
            "unsigned",
            None,
            f"{len(positive)} columns of current (`{positive[0]}`, …) are never negative: they are "
            "magnitudes without a direction.",
            "No action needed; they cannot serve as torques.",
        )


CHECKS: tuple[Check, ...] = (
    _reading,
    _rate,
    _loss,
    _excitation,
    check_duties,
    check_speeds,
    _ranged,
    _limits,
    _commands,
    _resolution,
    _unsigned,
    check_torques,
)
