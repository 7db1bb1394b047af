"""The interface of logs that name their own policy, before a diagnosis."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from envs.effects import EFFECTS
from hardware.log import Log
from sim2real.diagnosis.contract.logged import check_beforehand, check_logs
from sim2real.diagnosis.diagnose import diagnose
from sim2real.diagnosis.outcome import final_message
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.contract.walk import ABOUT, walk


def policy(actor: Any, size: int | None = None) -> Any:
    """What a policy's file is read as."""

    class Read(SimpleNamespace):
        def __call__(self, seen: np.ndarray) -> np.ndarray:
            return actor(seen)

    return Read(size=size, task=None, normalizer=None)


def told(folder: Path, log: Log, **meta: Any) -> Log:
    """Return a log that lies in a folder and says what it is of."""
    (folder / "OBS.yaml").write_text(yaml.safe_dump(ABOUT))
    return Log(log.columns, {"observation": "OBS.yaml", **meta}, folder / "log.csv")


def test_what_is_broken_stands_before_any_physics(tmp_path: Path) -> None:
    """The finding names the stage, the joint if it is of one alone, and the fix."""
    log, actor = walk(see={"joint_velocity": lambda x: x * np.array([1, -1, 1, 1])})
    asked = []

    def load(path: str | Path) -> Any:
        asked.append(Path(path))
        return policy(actor)

    found = check_beforehand([told(tmp_path, log, policy="run")], load)
    assert found.failed == ()
    assert found.verdict == "broken"
    (finding,) = found.findings
    assert (finding.check, finding.where) == ("contract", "knee_l")
    assert "sign" in finding.finding or "negat" in finding.finding
    assert finding.fix.endswith(".")
    assert asked == [tmp_path / "run"]


def test_the_policy_that_a_log_names_is_computed_again(tmp_path: Path) -> None:
    """A sound walk of the policy that it names, and the same walk blamed on another one."""
    log, actor = walk()
    sound = told(tmp_path, log, policy="run")
    assert check_logs([sound], load_policy=lambda _: policy(actor)).verdict == "holds"
    stranger = walk(seed=5)[1]
    found = check_beforehand([sound], lambda _: policy(stranger))
    assert found.verdict == "broken"
    assert "(policy)" in found.findings[0].finding


def test_logs_of_two_policies_are_checked_apart(tmp_path: Path) -> None:
    """Each against its own."""
    pairs = {seed: walk(seed=seed) for seed in (1, 2)}
    logs = [told(tmp_path, log, policy=f"run{seed}") for seed, (log, _) in pairs.items()]
    found = check_beforehand(logs, lambda path: policy(pairs[int(Path(path).name[-1])][1]))
    assert (found.findings, found.failed, found.verdict) == ((), (), "holds")


def test_a_policy_that_cannot_be_read_is_a_line(tmp_path: Path) -> None:
    """What the policy saw is checked all the same."""
    log, _ = walk(see={"gyro": np.degrees})

    def load(path: str | Path) -> Any:
        raise Sim2RealError(f"{path}: no such policy")

    found = check_beforehand([told(tmp_path, log, policy="gone")], load)
    assert [finding.where for finding in found.findings] == [None]
    assert "gyro" in found.findings[0].finding
    (line,) = found.failed
    assert line.startswith("the check of the policy's interface: ") and "gone" in line
    answer = check_logs([told(tmp_path, log, policy="gone")], load_policy=load)
    assert "no such policy" in answer.cannot_tell[0].text


@pytest.mark.parametrize(
    ("meta", "words"),
    [
        ({"observation": "NOWHERE.yaml"}, "NOWHERE"),
        ({"observation": None, "task": "Cartwheel"}, "Cartwheel"),
        ({"policy": "run"}, "5 numbers"),
    ],
)
def test_a_check_that_fails_is_a_line(tmp_path: Path, meta: dict[str, Any], words: str) -> None:
    """A description that is not there, a task that has none, a policy of another size."""
    log, actor = walk(rows=60)
    found = check_beforehand([told(tmp_path, log, **meta)], lambda _: policy(actor, size=5))
    assert (found.findings, found.verdict) == ((), None)
    assert words in found.failed[0]


def test_logs_without_a_policy_are_left_alone(tmp_path: Path) -> None:
    """No observation, no action, or nobody who says whose they are: nothing is said."""
    log, _ = walk(rows=60)
    columns = {name: v for name, v in log.columns.items() if not name.startswith("obs.")}
    others = [Log(log.columns, {}), told(tmp_path, Log(columns, {})), Log(columns, {"task": "X"})]
    found = check_beforehand(others, lambda _: pytest.fail("no policy is named"))
    assert (found.findings, found.failed, found.verdict) == ((), (), None)


def test_a_diagnosis_checks_the_interface_first(tmp_path: Path) -> None:
    """An arm whose policy saw a joint with the wrong sign: a finding beside `no_gap`."""
    (tmp_path / "arm.xml").write_text(arm.XML)
    log = arm.make_log(seconds=4.0)
    joints = list(log.joints)
    about = {
        "rate": round(1 / float(np.median(np.diff(log.time)))),
        "joints": joints,
        "actuators": list(log.actuators),
        "default_pose": [0.0] * len(joints),
        "observation": [{"term": "joint_position"}],
        "action": {"scale": 1.0, "offset": "zero"},
    }
    (tmp_path / "OBS.yaml").write_text(yaml.safe_dump(about))
    seen = np.column_stack([log.column(f"qpos.{name}") for name in joints])
    seen[:, 0] *= -1
    columns = dict(log.columns)
    columns |= {f"obs.{i}": v for i, v in enumerate(seen.T)}
    columns |= {f"action.{i}": log.column(f"ctrl.{n}") for i, n in enumerate(log.actuators)}
    asked = replace(log, columns=columns, meta={**log.meta, "observation": "OBS.yaml"})
    asked = replace(asked, path=tmp_path / "log.csv")
    report = diagnose(asked, tmp_path / "arm.xml", exclude=list(EFFECTS))
    (finding,) = [f for f in report.preflight if f.check == "contract"]
    assert finding.where == joints[0]
    assert report.failed == ()
    assert any("Between the policy and the robot" in words for words in final_message(report))
    assert report.evidence.inputs["policy's interface"] == "broken"
