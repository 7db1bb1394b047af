"""The contract of logs that say themselves which task and policy they are of.

    answer = check_logs(logs, load_policy=load_actor)      # one policy for all
    found = check_beforehand(logs, load_actor)             # before a diagnosis
    found.findings, found.failed

`deploy` writes `task` and `policy` into the metadata of its logs; other programs may write
`policy` and `observation` (docs/how-to/check_policy_interface.md). Paths are relative to the log.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from envs.errors import EnvsError
from hardware.errors import HardwareError
from hardware.log import Log
from sim2real.diagnosis.contract import answer as contract
from sim2real.diagnosis.contract.check import check_contract
from sim2real.diagnosis.contract.description import READY, read_description
from sim2real.diagnosis.contract.terms import ContractError
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
SAID = ("task", "policy", "observation")  # metadata that say whose a log is
CHECK = "contract"  # what a report's findings of this are called
POLICY = "policy"  # where an answer says that no action was computed again
CLOCK = "clock"  # a stage whose findings preflight has itself
WHAT = "the check of the policy's interface"


class Policy(Protocol):
    """What `sim2real.deployment.actors.load_actor` returns."""

    @property
    def size(self) -> int | None:
        """O; None where the file does not say."""

    @property
    def task(self) -> str | None:
        """The class name of its task, where it is ours."""

    @property
    def normalizer(self) -> np.ndarray | None:
        """Mean and std (2, O) that are inside it, where it says them."""

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Map observations (n, O) to actions (n, A)."""
        ...


LoadPolicy = Callable[[str | Path], Policy]


class Beforehand(NamedTuple):
    """What the check found before a diagnosis, what it could not do, and its answer in a word."""

    findings: tuple[Finding, ...] = ()
    failed: tuple[str, ...] = ()
    verdict: str | None = None  # None where the logs have no policy


def check_logs(
    logs: Sequence[Log],
    observation: str | Path | None = None,
    load_policy: LoadPolicy | None = None,
    actor: str | Path | None = None,
    settings: Settings = DEFAULT,
) -> contract.Answer:
    """Check the interface of one policy.

    Args:
        logs: of one robot and policy.
        observation: an OBS.yaml or the name of a ready-made one; None: what the logs name,
            else that of their task or of the policy's.
        load_policy: reads a policy's file; None compares no actions.
        actor: the policy's file; None: the policy that the logs name.
        settings: when a fault is named.

    Raises:
        Sim2RealError: a policy or a description that cannot be read, or that do not fit.
    """
    place, policy, unread = actor or named(logs, "policy"), None, None
    if place is not None and load_policy is not None:
        try:
            policy = load_policy(place)
        except (Sim2RealError, ImportError) as error:  # without torch, runs cannot be read
            if actor is not None:
                raise
            unread = f"the logs name a policy, and no action was computed again: {error}"
    source = observation or _described_by(logs, policy.task if policy else None)
    about = read_description(source, *_driven(logs[0]))
    if policy is None:
        answer = check_contract(logs, about, settings=settings)
    else:
        about.check_size(str(place), "the policy takes", policy.size)
        answer = check_contract(logs, about, policy, policy.normalizer, settings, str(place))
    if unread:
        rest = [one for one in answer.cannot_tell if one.where != POLICY]
        answer = replace(answer, cannot_tell=(contract.Open(POLICY, unread), *rest))
    return answer


def check_beforehand(
    logs: Sequence[Log],
    load_policy: LoadPolicy | None = None,
    settings: Settings = DEFAULT,
    actor: str | Path | None = None,
) -> Beforehand:
    """Check the interface of every policy that logs are of; a check that fails is a line.

    Logs without observations, actions or a named task or policy are left out. The other arguments
    are those of `check_logs`.
    """
    groups: dict[tuple[str, ...], list[Log]] = {}
    for log in filter(has_policy, logs):
        groups.setdefault(tuple(str(log.meta.get(key)) for key in SAID), []).append(log)
    findings, failed, verdicts = [], [], []
    for group in groups.values():
        try:
            answer = check_logs(group, None, load_policy, actor, settings)
        except (Sim2RealError, EnvsError, HardwareError) as error:
            failed.append(f"{WHAT}: {error}")
            continue
        except Exception as error:  # a policy's file may be of any library
            log_.exception("%s failed", WHAT)
            failed.append(f"{WHAT}: {type(error).__name__}: {error}")
            continue
        verdicts.append(answer.verdict)
        findings += [_as_finding(f, group[0]) for f in answer.findings if f.stage != CLOCK]
        if load_policy is not None and named(group, "policy"):  # and could not be read
            failed += [f"{WHAT}: {one.text}" for one in answer.cannot_tell if one.where == POLICY]
    ranked = [v for v in ("broken", "holds", "cannot_tell") if v in verdicts]
    return Beforehand(tuple(dict.fromkeys(findings)), tuple(failed), ranked[0] if ranked else None)


def has_policy(log: Log) -> bool:
    """Return whether a log holds a policy's observations and actions, and names either's maker."""
    return any(map(log.meta.get, SAID)) and {"obs.0", "action.0"} <= set(log.columns)


def named(logs: Sequence[Log], key: str) -> Path | None:
    """Return the file that the metadata of all logs name; None if they name none or several."""
    found = {place_of(log, key) for log in logs}
    return found.pop() if len(found) == 1 else None


def place_of(log: Log, key: str) -> Path | None:
    """Return the file that a log's metadata name, seen from its folder; None if there is none."""
    name: Any = log.meta.get(key)
    if not isinstance(name, str) or not name:
        return None
    return (log.path.parent if log.path else Path()) / Path(name).expanduser()


def _described_by(logs: Sequence[Log], task: str | None) -> str | Path:
    """Return the description that the logs name, else that of their task or of the policy's."""
    said = {log.meta.get("observation") for log in logs} - {None}
    if len(said) == 1:
        one = str(said.pop())
        return one if one in READY else named(logs, "observation") or one
    tasks = {task} if task else {log.meta.get("task") for log in logs} - {None}
    found = [str(name).lower() for name in tasks if str(name).lower() in READY]
    if len(tasks) != 1 or not found:
        what = ", ".join(sorted(map(str, tasks))) or "no task"
        raise ContractError(
            f"the logs and the policy name {what}, which has no preset description; "
            "give observation=OBS.yaml (docs/how-to/check_policy_interface.md)"
        )
    return found[0]


def _driven(log: Log) -> tuple[list[str], list[str]]:
    """Return the joints that have a command of the same name, and their actuators.

    Where none has, the joints and actuators are paired in the order of the columns.
    """
    same = [name for name in log.actuators if name in log.joints]
    if same:
        return same, same
    count = min(len(log.joints), len(log.actuators))
    return log.joints[:count], log.actuators[:count]


def _as_finding(found: contract.Finding, log: Log) -> Finding:
    """Return a fault as a line of a report; it belongs to a joint if it is of that one alone."""
    where = found.where.partition(": ")[2]
    others = "".join(f" Or, as likely: {rival.text}." for rival in found.among)
    return Finding(
        CHECK,
        where if where in log.joints else None,
        f"Between the policy and the robot ({found.stage}): {found.text}.{others}",
        f"{found.fix[:1].upper()}{found.fix[1:]}.",
    )
