"""The verb `contract`: did the policy see and do what it was trained on?

Exit status: 0 where the contract holds, 3 where it is broken, 4 where the log held nothing that
could be compared.
"""

import logging
from pathlib import Path

from hardware.log import read_logs
from sim2real.diagnosis.contract.answer import Answer
from sim2real.diagnosis.contract.logged import Policy, check_logs
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *, log: str | list[str] | None, actor: str | None, observation: str | None, out: Path
) -> Answer:
    """Check a policy's interface on logs.

    Args:
        log: a log, a folder of logs, or a list of these.
        actor: the policy: ONNX, a torch.export archive, an export or a run of ours; None
            takes the one that the logs name, if any.
        observation: an OBS.yaml (docs/how-to/check_policy_interface.md) or the name of a
            ready-made one; None: what the logs name, else that of their task or the policy's.
        out: the run's folder; gets contract.json and contract.html.

    Returns:
        The answer; its `exit_status` is that of the process.

    Raises:
        Sim2RealError: no log, a policy or a description that cannot be read, or that do not fit.
    """
    if not log:
        raise Sim2RealError("contract needs a recording; give log=PATH")

    def load_policy(path: str | Path) -> Policy:
        from sim2real.deployment.actors import load_actor  # here: it needs torch

        return load_actor(path)

    answer = check_logs(read_logs(log), observation, load_policy, actor)
    answer.write(Path(out))
    for finding in answer.findings:
        log_.warning("%s: %s; %s", finding.where, finding.text, finding.fix)
    log_.info("the contract %s", answer.verdict.replace("_", " "))
    return answer
