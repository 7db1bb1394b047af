"""The whole check of a policy's interface; of it, the gains, the rate and the clocks.

answer = check_contract(read_logs("logs/"), about, actor)
answer.write(Path("outputs/mine"))
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.contract.answer import Answer, Finding, Stage
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.stages import (
    Actor,
    actions_of,
    check_action,
    check_observation,
    check_policy,
)
from sim2real.diagnosis.contract.terms import ContractError
from sim2real.diagnosis.preflight.clocks import check_clocks
from sim2real.diagnosis.settings import DEFAULT, Settings

TORQUE = "sensor.torque_"  # N·m, of an actuator


def check_contract(
    logs: Sequence[Log],
    about: Description,
    actor: Actor | None = None,
    normalizer: np.ndarray | None = None,
    settings: Settings = DEFAULT,
    policy: str | None = None,
) -> Answer:
    """Check whether a policy saw and did what it was trained on.

    Args:
        logs: of the same robot and policy.
        about: what the policy was trained to see and do.
        actor: the policy, observations (n, D) to actions (n, A); None leaves it out.
        normalizer: mean and std (2, D) inside the policy, where it says them.
        settings: when a fault is named.
        policy: its name, for the answer.

    Raises:
        ContractError: logs and description that cannot be compared, in one sentence.
    """
    limits, rows = settings.contract, Rows.of(logs)
    if len(rows) < limits.rows_min:
        raise ContractError(
            f"{rows.place}: {len(rows)} rows are too few; log at least {limits.rows_min}"
        )
    actions_of(rows, about)
    whole, most = Stage(), settings.inference.equivalents_max - 1
    check_observation(whole, rows, about, limits)
    check_policy(whole, rows, about, actor, limits, normalizer)
    check_action(whole, rows, about, limits)
    _check_gains(whole, rows, about, settings)
    compared = bool(whole.checked)  # a clock alone is nothing compared
    _check_rate(whole, logs, about, settings)
    return Answer(
        "broken" if whole.findings else "holds" if compared else "cannot_tell",
        tuple(replace(one, among=one.among[:most]) for one in whole.findings),
        tuple(dict.fromkeys(whole.cannot_tell)),
        whole.checked if compared else {},
        {"logs": rows.place, "rows": len(rows), "description": about.name, "policy": policy},
    )


def _check_gains(stage: Stage, rows: Rows, about: Description, settings: Settings) -> None:
    """Regress torque on error and speed, and compare with the described gains."""
    if about.action.kp is None:
        return
    logged = [f"{TORQUE}{name}" for name in about.actuators]
    speeds = [f"qvel.{name}" for name in about.joints]
    if not rows.has([*logged, *speeds]):
        text = f"kp and kd need {TORQUE}<actuator> and qvel.<joint>, which are not logged"
        stage.open("gains", text)
        return
    torque, speed = rows.matrix(logged), rows.matrix(speeds)
    error = rows.matrix([f"ctrl.{name}" for name in about.actuators])
    # what was measured before a row's command answers to the command before it
    error = rows.older(error, 1) - rows.matrix([f"qpos.{name}" for name in about.joints])
    use, low, high = rows.deep(1), *settings.preflight.ratio
    ratios: dict[str, dict[str, float]] = {"kp": {}, "kd": {}}
    for j, name in enumerate(about.joints):
        data = np.stack([error[use, j], -speed[use, j]], axis=1)
        found, *_ = np.linalg.lstsq(data, torque[use, j], rcond=None)
        rest = torque[use, j] - data @ found
        power = np.sum((torque[use, j] - torque[use, j].mean()) ** 2)
        if rest @ rest >= (1 - settings.preflight.share) * power:
            text = "torque is not a function of position and speed, so its gains are unknown"
            stage.open(f"gains: {name}", text)
            continue
        for key, value in zip(ratios, found, strict=True):
            described = getattr(about.action, key)
            if described is not None:
                ratios[key][name] = float(value / described[j])
                stage.checked[f"gains: {key} {name}"] = abs(ratios[key][name] - 1)
    for key, of in ratios.items():
        off = {name: ratio for name, ratio in of.items() if not low <= ratio <= high}
        stage.findings += _gain_findings(key, off, len(about.joints), settings)


def _gain_findings(
    key: str, off: dict[str, float], joints: int, settings: Settings
) -> Iterator[Finding]:
    """Yield a finding for all joints if they agree, else one a joint."""
    if not off:
        return
    middle = float(np.median(list(off.values())))
    low, high = settings.preflight.ratio
    shared = len(off) == joints and all(low <= r / middle <= high for r in off.values())
    for name, ratio in ({"every joint": middle} if shared else off).items():
        text = f"{key} of {name} is {ratio:.3g} times the described one"
        fix = f"set {key} in the unit that the drive's firmware takes; it scales it by {ratio:.3g}"
        yield Finding("gains", key, name, text, fix, abs(ratio - 1), 0.0, None, ratio)


def _check_rate(stage: Stage, logs: Sequence[Log], about: Description, settings: Settings) -> None:
    """Compare the rows' interval with the described rate, and ask whether times were measured."""
    steps = [np.diff(part.time) for log in logs for part in log.episodes()]
    rate = 1.0 / float(np.median(np.concatenate(steps)))
    off = abs(rate / about.rate - 1)
    stage.checked["clock: rate"] = off
    if off > settings.preflight.rate_error:
        text = f"the log has {rate:.4g} rows a second, and the policy was trained at {about.rate:g}"
        fix = f"run the policy {about.rate:g} times a second, or log one row a control step"
        stage.findings.append(Finding("clock", "rate", "rows", text, fix, off, 0.0, None, rate))
    for clock in check_clocks(logs, settings):
        if clock.where is None:  # those of single joints are no part of the interface
            stage.findings.append(
                Finding("clock", clock.check, "rows", clock.finding, clock.fix, 0.0, 0.0)
            )
