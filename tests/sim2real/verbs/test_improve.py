"""The loop in one command, with a diagnosis that is given: its rounds, its ends, its resuming."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from envs.distribution_file import read
from envs.effects import load_effects, make, write_effects
from hardware.log import read_logs, write_log
from sim2real.deployment.trained import load_policy
from sim2real.diagnosis.report import text
from sim2real.loops.improve import checks, improve, steps
from sim2real.loops.improve.improve import Improvement
from sim2real.runs.checkpoint import read_metadata
from sim2real.runs.errors import RunInterrupted, Sim2RealError
from tests.sim2real.trained import SMALL_ES, run_verb, train

WEAK = 0.3  # of the motor's torque, as the robot has it
FOUND = (0.29, 0.31)  # what the diagnosis says: a 90 % interval about 0.3
POLICY = [word for word in SMALL_ES if not word.startswith("policy=")] + ["policy=linear"]
QUICK = ["trials=2", "settle=0.1", "seconds=1", "motions=[ramp]", "rollouts=2", "iterations=1"]
REPORT = {
    "verdict": "explained",
    "gap": {"unit": "rad", "before": 0.02, "after": 0.001, "noise_floor": 0.0005},
    "causes": [{"effect": "motor_strength", "where": "hinge", "closed": 0.98}],
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy for the bench."""
    return train(tmp_path_factory.mktemp("es") / "run", POLICY)


@pytest.fixture
def diagnosed(monkeypatch: pytest.MonkeyPatch) -> list[list[Any]]:
    """Put a known answer in place of the diagnosis; return the logs that it was given each time."""
    given: list[list[Any]] = []

    def run_diagnosis(logs: list, *settings: Any) -> SimpleNamespace:
        given.append(logs)
        return SimpleNamespace(report=None)

    def write(found: SimpleNamespace, folder: Path) -> None:
        effects = [(make("motor_strength", where="hinge"), (WEAK,))]
        write_effects(folder / "effects.yaml", effects, [FOUND])
        (folder / "report.json").write_text(json.dumps(REPORT))

    monkeypatch.setattr(steps, "run_diagnosis", run_diagnosis)
    monkeypatch.setattr(steps, "write", write)
    monkeypatch.setattr(text, "verdict_sentence", lambda report: "found")
    return given


def hidden(folder: Path) -> str:
    """Hide a weak motor; return the override."""
    path = folder / "hidden.yaml"
    path.write_text(f"- {{effect: motor_strength, where: hinge, value: {WEAK}}}\n")
    return f"robot.hidden={path}"


def go(run: Path, out: Path, *text: str, **changes: Any) -> Improvement:
    """Improve as the command line does; `changes` are arguments of the verb."""
    line = ["run=improve", f"checkpoint={run}", *QUICK, *text]
    (out / ".hydra").mkdir(parents=True, exist_ok=True)
    given = [word for word in yaml.safe_load((run / ".hydra" / "overrides.yaml").read_text())]
    (out / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump([*given, *line]))
    return run_verb(line, out, **changes)


def told(out: Path) -> dict[str, Any]:
    """Return improve.json, without the folder that paths begin with."""
    text = (out / "improve.json").read_text()
    return json.loads(text.replace(str(out), "OUT"))


def test_a_round_finds_retrains_and_deploys(run: Path, tmp_path, diagnosed) -> None:
    """A weak motor is in the second simulator, as uncertain as it is; all of it is on disk."""
    out = tmp_path / "out"
    done = go(run, out, hidden(tmp_path), "rounds=1")
    given, first = done.story.rounds
    assert (first.contract, first.verdict) == ("holds", "explained")
    behind = done.story.behind(given)
    assert behind is not None and behind.high < 0
    assert done.end in ("within_noise", "rounds", "no_gain")
    ((stand, again),) = diagnosed
    assert [log.path.name for log in (stand, again)] == ["a.csv", "b.csv"]
    place = out / "round_1"
    names = ("contract.json", "stand/model.xml", "diagnosis/effects.yaml", "worth/worth.json")
    for name in (*names, "distribution.yaml", "deploy/logs/episode-0001.csv", "table.md"):
        assert (place / name).is_file(), name
    law = read(place / "distribution.yaml")
    assert law.std[0] == pytest.approx((FOUND[1] - FOUND[0]) / 2 / 1.645, rel=1e-3)
    facts = told(out)
    assert (facts["end"], facts["rounds"][1]["causes"][0]["value"]) == (done.end, WEAK)
    for number, one in enumerate(facts["rounds"]):
        link = json.loads((out / f"round_{number}" / "deploy" / "link.json").read_text())
        assert one["link"] == link and link["servos"]["hinge"]["lost"] == 0 < link["periods"]
    assert "motor_strength.hinge 0.3 [0.29, 0.31]" in (out / "improve.md").read_text()
    assert f"It ended because {facts['words']}" in (out / "improve.md").read_text()
    assert (out / "plots" / "improve.png").stat().st_size > 5000
    trained = load_policy(place / "policy")  # any verb takes it
    assert [e.name for e in trained.environment.tasks.effects] == ["motor_strength"]
    assert read_metadata(place / "policy")["iteration"] == 2  # one more than the policy had


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [1, 2])
def test_a_loop_that_was_killed_ends_alike(rounds, run, tmp_path, diagnosed, monkeypatch) -> None:
    """Ctrl-C in the middle of a round, and of a deployment; resumed, every return is the same."""
    settings = (hidden(tmp_path), f"rounds={rounds}", "tolerance=0")
    monkeypatch.setattr(improve.ImprovementHistory, "end", lambda story: None)
    go(run, tmp_path / "whole", *settings)
    part, price = tmp_path / "part", checks.compute_cause_costs

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(checks, "compute_cause_costs", interrupted)
    with pytest.raises(RunInterrupted, match=rf"stopped in round 1; continue with resume={part}"):
        go(run, part, *settings)
    monkeypatch.setattr(checks, "compute_cause_costs", price)
    drive, count = improve.RobotSetup.deploy, iter(range(10))

    def broken(site: Any, trained: Any, folder: Path) -> list[float]:
        returns = drive(site, trained, folder)
        if next(count) == 1:
            (folder / "state.npz").unlink()
            raise KeyboardInterrupt
        return returns

    monkeypatch.setattr(improve.RobotSetup, "deploy", broken)
    with pytest.raises(RunInterrupted):
        go(run, tmp_path / "other", *settings, f"resume={part}")
    assert len(diagnosed) == rounds + 1  # once a round for the whole, once for the part
    monkeypatch.setattr(improve.RobotSetup, "deploy", drive)
    go(run, tmp_path / "other", *settings, f"resume={part}")
    assert told(part)["rounds"] == told(tmp_path / "whole")["rounds"]
    assert [len(logs) for logs in diagnosed] == [2, 4][:rounds] * 2  # all recordings so far
    with pytest.raises(Sim2RealError, match=r"the earlier loop had trials=2, this one 3"):
        go(run, tmp_path / "other", *settings, f"resume={part}", "trials=3")


@pytest.mark.slow
def test_logs_of_a_robot_that_is_elsewhere(run: Path, tmp_path, diagnosed: list[list[Any]]) -> None:
    """Its logs take the place of the first deployment; nothing moves, and the policy is trained."""
    go(run, tmp_path / "made", hidden(tmp_path), "rounds=1")
    logs = tmp_path / "made" / "round_0" / "deploy" / "logs"
    done = go(run, tmp_path / "out", f"log={logs}")
    assert done.end == "no_robot"
    assert [one.robot for one in done.story.rounds] == [None, None]
    assert [log.path.name for log in diagnosed[-1]] == ["episode-0000.csv", "episode-0001.csv"]
    assert not (tmp_path / "out" / "round_1" / "deploy").exists()
    assert done.story.rounds[1].contract == "holds"
    (tmp_path / "odd").mkdir()
    for number, log in enumerate(read_logs(logs)):
        columns = {**log.columns, "obs.0": -log.columns["obs.0"]}
        write_log(tmp_path / "odd" / f"{number}.csv", replace(log, columns=columns))
    broken = go(run, tmp_path / "broken", f"log={tmp_path / 'odd'}")
    assert broken.end == "interface"
    assert len(diagnosed) == 2  # no physics is looked for


def test_a_robot_that_is_stopped_ends_it(run: Path, tmp_path: Path) -> None:
    """The guard's words are the reason, the exit status is 3, and what there is stays."""
    path = tmp_path / "hidden.yaml"
    path.write_text("- {effect: supply_voltage, where: null, value: 0.75}\n")
    done = go(run, tmp_path / "out", f"robot.hidden={path}")
    assert (done.end, done.exit_status) == ("stopped", 3)
    assert "V, not 5.0 V" in told(tmp_path / "out")["why"]
    assert "torque stays off" in done.why


def test_nothing_found_on_the_ground_ends_it(run: Path, tmp_path, diagnosed, monkeypatch) -> None:
    """Without a stand its own episodes are diagnosed; no effects leave nothing to train with."""

    def write(found: SimpleNamespace, folder: Path) -> None:
        write_effects(folder / "effects.yaml", [])

    monkeypatch.setattr(steps, "write", write)
    done = go(run, tmp_path / "out", hidden(tmp_path), "stand=false")
    assert done.end == "nothing_found" and len(done.story.rounds) == 1
    assert [log.path.name for log in diagnosed[0]] == ["episode-0000.csv", "episode-0001.csv"]
    assert not (tmp_path / "out" / "round_1" / "stand").exists()
    assert load_effects(tmp_path / "out" / "round_1" / "diagnosis" / "effects.yaml") == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (("trials=1",), "trials=1: at least 2 episodes"),
        (("rounds=0",), "rounds=0 must be at least 1"),
        (("port=/dev/x",), r"bench1 at /dev/x would move; .* arm=true"),
        (("model=conf/config.yaml",), "give log=PATH"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(run, tmp_path, text, message) -> None:
    """With one sentence."""
    with pytest.raises(Sim2RealError, match=message):
        go(run, tmp_path / "out", *text)
    assert not (tmp_path / "out" / "round_0").exists()


def test_the_operator_s_no_moves_nothing(run: Path, tmp_path: Path, monkeypatch) -> None:
    """A real robot's port is not even opened; nobody at the terminal is a no, too."""
    asked: list[str] = []

    def ask(question: str) -> str:
        asked.append(question)
        raise EOFError

    monkeypatch.setattr("builtins.input", ask)
    done = go(run, tmp_path / "out", "port=/dev/there-is-none", "arm=true")
    assert done.end == "declined"
    assert asked == [
        "bench1 at /dev/there-is-none will run 2 episodes of the policy of round_0. Put it where "
        "episodes start, and clear the space around it. Go on? [y/N] "
    ]
