"""The whole check of a policy's interface.

answer = check_contract(read_logs("logs/"), about, actor)
answer.write("contract.json")
"""

from collections.abc import Sequence

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.contract.answer import Answer, answer_of
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.servo import check_gains, check_rate
from sim2real.diagnosis.contract.stages import (
    Actor,
    Stage,
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
    stages: list[Stage] = [
        check_observation(rows, about, limits),
        check_policy(rows, about, actor, limits, normalizer),
        check_action(rows, about, limits),
        check_gains(rows, about, settings),
        check_rate(logs, about, settings),
    ]
    clock_alone = {key: value for stage in stages[:4] for key, value in stage.checked.items()}
    checked = {**clock_alone, **stages[4].checked} if clock_alone else {}
    return answer_of(
        [finding for stage in stages for finding in stage.findings],
        [one for stage in stages for one in stage.cannot_tell],
        checked,
        {"logs": rows.place, "rows": len(rows), "description": about.name, "policy": policy},
    )
