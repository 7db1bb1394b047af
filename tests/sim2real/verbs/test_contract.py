"""The verb `contract`: on logs of a robot and of others, its files and its exit status."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.policies.tasks import OWN
from envs.tasks import Hopper2, Quad12
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.exported import ExportedPolicy
from hardware.log import Log, read_log, write_log
from hardware.rows import RobotRows
from sim2real import __main__ as program
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis.contract.walk import ABOUT, walk
from tests.sim2real.trained import run_verb


@pytest.fixture(scope="module")
def logged(tmp_path_factory) -> Path:
    """An episode of a small policy on the emulated hopper, as `deploy` logs it."""
    folder, task = tmp_path_factory.mktemp("hopper2"), Hopper2(fidelity="servo", seconds=0.6)
    rows = RobotRows(task, ServoBackend(load_robot("hopper2"), settle=0.1), folder)
    weight = np.random.default_rng(1).normal(0, 0.3, (8, 2))
    observation = rows.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64))
    while not rows.over:
        observation = rows.step(None, 0.2 * np.tanh(observation @ weight)).observation
    rows.close()
    return folder


def run(out: Path, *overrides: str):
    """Run the verb with overrides."""
    return run_verb(["run=contract", *overrides], out)


def test_a_robots_own_log_says_what_it_is_of(logged, tmp_path):
    """Nothing but the log is needed; what the policy saw is what its sensors measured."""
    answer = run(tmp_path, f"log={logged}")
    assert answer.findings == ()
    assert answer.verdict == "holds"
    assert answer.inputs["description"] == "hopper2"
    assert {"observation: joint_position", "observation: phase", "action: ctrl"} <= set(
        answer.checked
    )
    assert json.loads((tmp_path / "contract.json").read_text())["verdict"] == "holds"
    assert "Holds" in (tmp_path / "contract.html").read_text()


def walked(folder: Path, order: np.ndarray) -> None:
    """Let quad12 walk for a second on the emulated bus; its policy sees the joints in an order."""
    task, policy = Quad12(seconds=1.0), ExportedPolicy.load(OWN)
    right, columns = task.observe, np.r_[0, 1, 2 + order, 14, 15]
    task.observe = lambda state: right(state)[:, columns]  # type: ignore[method-assign]
    rows = RobotRows(task, ServoBackend(load_robot("quad12"), settle=0.3), folder)
    rows.facts["policy"] = str(OWN)
    observation = rows.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64))
    while not rows.over:
        observation = rows.step(None, policy(observation)).observation
    rows.close()


@pytest.mark.slow
def test_the_walk_of_a_trained_quadruped(tmp_path):
    """Its own policy on the emulated bus, through a noisy IMU: sound, or two hips swapped."""
    walked(tmp_path / "sound", np.arange(12))
    answer = run(tmp_path, f"log={tmp_path / 'sound'}")
    assert (answer.verdict, answer.findings) == ("holds", ())
    assert any(what.startswith("policy") for what in answer.checked)
    swapped = np.arange(12)
    swapped[[1, 4]] = [4, 1]
    walked(tmp_path / "swapped", swapped)
    answer = run(tmp_path, f"log={tmp_path / 'swapped'}")
    [fault] = answer.findings
    assert (fault.stage, fault.fault) == ("observation", "permutation")
    assert fault.where == "joint_position: hip_fl, hip_fr"
    assert fault.among == ()


def test_what_was_broken_on_the_way_is_named(logged, tmp_path):
    """A knee that the policy saw with the wrong sign, in the robot's own log."""
    log = read_log(next(logged.glob("*.csv")))
    columns = {**log.columns, "obs.1": -log.column("obs.1")}
    write_log(tmp_path / "log.csv", Log(columns, {"task": "Hopper2"}))
    answer = run(tmp_path, f"log={tmp_path / 'log.csv'}")
    assert [(f.fault, f.where) for f in answer.findings] == [("sign", "joint_position: knee")]


def test_names_from_files_are_escaped(tmp_path):
    """A description's name is text, whatever it holds."""
    import yaml

    log, _ = walk(see={"gyro": np.degrees}, rows=100)
    write_log(tmp_path / "log.csv", log)
    about = {**ABOUT, "name": "<script>alert(1)</script>"}
    (tmp_path / "OBS.yaml").write_text(yaml.safe_dump(about))
    run(tmp_path, f"log={tmp_path / 'log.csv'}", f"observation={tmp_path / 'OBS.yaml'}")
    page = (tmp_path / "contract.html").read_text()
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    assert "gyro is in degrees" in page


def test_logs_that_name_no_task_need_a_description(tmp_path):
    """The sentence says what to give."""
    write_log(tmp_path / "log.csv", walk(rows=40)[0])
    with pytest.raises(Sim2RealError, match=r"observation=OBS\.yaml"):
        run(tmp_path, f"log={tmp_path / 'log.csv'}")


def test_the_exit_status_says_the_answer(tmp_path, monkeypatch):
    """3 for a broken contract, from the command line."""
    import yaml

    write_log(tmp_path / "log.csv", walk(see={"gyro": np.degrees}, rows=100)[0])
    (tmp_path / "OBS.yaml").write_text(yaml.safe_dump(ABOUT))
    words = ["contract", "log.csv", "observation=OBS.yaml", "out=here"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["sim2real", *words])
    with pytest.raises(SystemExit) as ended:
        program.main()
    assert ended.value.code == 3
    assert json.loads(Path("here/contract.json").read_text())["verdict"] == "broken"
