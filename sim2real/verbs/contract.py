"""The verb `contract`: did the policy see and do what it was trained on?

    python -m sim2real run=contract log=logs/                              # a log of run=deploy
    python -m sim2real run=contract log=logs/ actor=policy.onnx observation=OBS.yaml

Logs of our own tasks say which task they are of, which describes the observation; our exports and
checkpoints say it too. Any other policy needs `observation=`: an OBS.yaml (docs/contract.md), or a
ready-made description. Nothing in the policy's file is executed.

Exit status: 0 where the contract holds, 3 where it is broken, 4 where the log held nothing that
could be compared.
"""

from __future__ import annotations

import logging
from pathlib import Path

from hardware.log import Log, read_logs
from sim2real.diagnosis.contract.answer import Answer
from sim2real.diagnosis.contract.check import check_contract
from sim2real.diagnosis.contract.description import READY, read_description
from sim2real.diagnosis.contract.page import write_page
from sim2real.diagnosis.contract.terms import ContractError
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *,
    log: str | list[str] | None,
    actor: str | None,
    observation: str | None,
    out: Path,
) -> Answer:
    """Check a policy's interface on logs.

    Args:
        log: a log, a folder of logs, or a list of these.
        actor: the policy: ONNX, a torch.export archive, an export or a run of ours; None to compare
            no actions with it.
        observation: an OBS.yaml or the name of a ready-made one; None takes that of the task of the
            log or of the policy.
        out: the run's folder; gets contract.json and contract.html.

    Returns:
        The answer; its `exit_status` is that of the process.

    Raises:
        Sim2RealError: no log, a policy or a description that cannot be read, or that do not fit.
    """
    if not log:
        raise Sim2RealError("contract needs a recording; give log=PATH")
    logs = read_logs(log)
    policy, task, normalizer = None, None, None
    if actor is not None:
        from sim2real.deployment.actors import load_actor  # here: it needs torch

        policy = load_actor(actor)
        task, normalizer = policy.task, policy.normalizer
    about = read_description(observation or described_by(logs, task), *driven(logs[0]))
    if policy is not None and policy.size not in (None, about.size):
        raise ContractError(
            f"{actor}: the policy takes {policy.size} numbers, and {about.name} describes "
            f"{about.size}: {about.says_sizes()}; correct the description's terms"
        )
    answer = check_contract(logs, about, policy, normalizer, policy=actor)
    answer.write(Path(out) / "contract.json")
    write_page(answer, Path(out) / "contract.html")
    for finding in answer.findings:
        log_.warning("%s: %s; %s", finding.where, finding.text, finding.fix)
    log_.info("the contract %s", answer.verdict.replace("_", " "))
    return answer


def described_by(logs: list[Log], task: str | None) -> str:
    """Return the ready-made description of the task that the policy or the logs name.

    Raises:
        ContractError: none is named, or one that has no description.
    """
    named = {task} if task else {log.meta.get("task") for log in logs} - {None}
    found = [str(name).lower() for name in named if str(name).lower() in READY]
    if len(named) != 1 or not found:
        what = ", ".join(sorted(map(str, named))) or "no task"
        raise ContractError(
            f"the logs and the policy name {what}, which no ready-made description belongs to; "
            "give observation=OBS.yaml (docs/contract.md)"
        )
    return found[0]


def driven(log: Log) -> tuple[list[str], list[str]]:
    """Return the joints that have a command of the same name, and their actuators.

    Where none has, the joints and actuators are paired in the order of the columns.
    """
    same = [name for name in log.actuators if name in log.joints]
    if same:
        return same, same
    count = min(len(log.joints), len(log.actuators))
    return log.joints[:count], log.actuators[:count]
