"""The whole check of a policy's interface.

answer = check_contract(read_logs("logs/"), about, actor)
answer.write(Path("outputs/mine"))
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.contract.answer import Answer, Stage
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.servo import check_gains, check_rate
from sim2real.diagnosis.contract.stages import (
    Actor,
    actions_of,
    check_action,
    check_observation,
    check_policy,
)
from sim2real.diagnosis.contract.terms import ContractError
from sim2real.diagnosis.settings import DEFAULT, Settings


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
    check_gains(whole, rows, about, settings)
    compared = bool(whole.checked)  # a clock alone is nothing compared
    check_rate(whole, logs, about, settings)
    return Answer(
        "broken" if whole.findings else "holds" if compared else "cannot_tell",
        tuple(replace(one, among=one.among[:most]) for one in whole.findings),
        tuple(dict.fromkeys(whole.cannot_tell)),
        whole.checked if compared else {},
        {"logs": rows.place, "rows": len(rows), "description": about.name, "policy": policy},
    )
