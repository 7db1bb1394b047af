"""Deploying: the policy on the emulated robot, adapting there, interrupted and gone on."""

import csv
import json
import logging
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from tensordict import TensorDictBase

from envs.torch_env import RowsEnv
from hardware.calibration import calibration_of, write_calibration
from hardware.config import ROBOTS, load_robot
from hardware.env import HardwareEnv
from hardware.errors import RobotError, SafetyError, ServoError
from hardware.log import read_logs
from hardware.rows import RobotRows
from sim2real.config.compose import compose, instantiate, save
from sim2real.deployment import deploy
from sim2real.deployment.session import Deployment
from sim2real.learning.modules.acting import Actor
from sim2real.learning.transforms import affine
from sim2real.runs.checkpoint import find
from sim2real.runs.errors import RunInterrupted, Sim2RealError
from sim2real.verbs import contract, replay
from sim2real.verbs import deploy as verb
from tests.sim2real.trained import SMALL_ES, SMALL_PPO, note_worlds, run_verb, train

CLIMB = ["adapt=hillclimb", "adapt.queries=3", "adapt.sigma=0.3"]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A policy of evolution strategies for the bench."""
    return train(tmp_path_factory.mktemp("es") / "run", SMALL_ES)


def go(run: Path, out: Path, *overrides: str, **changes: Any) -> Deployment:
    """Deploy as the command line does; `changes` are arguments of the verb."""
    words = ["run=deploy", f"checkpoint={run}", "trials=2", "settle=0.2", *overrides]
    _, arguments = instantiate(compose(words), out)
    return verb.run(**(arguments | changes))


def bench(**changes: Any) -> dict[str, Any]:
    """Return the bench's file with changes."""
    return yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8")) | changes


def test_a_policy_runs_on_the_robot_and_is_compared_with_its_simulator(run, tmp_path):
    """Returns, logs, plots and a table; on a robot that hides nothing both worlds agree."""
    done = go(run, tmp_path)
    assert len(done.before) == 2
    assert done.after == []
    answer = contract.run(log=str(tmp_path / "logs"), actor=None, observation=None, out=tmp_path)
    assert answer.verdict == "holds"
    assert answer.inputs["policy"] == str(find(run).resolve())
    assert answer.checked["policy: action"] < 1e-4
    (row,) = csv.DictReader((tmp_path / "table.csv").open())
    robot, twin = float(row["return on the robot"]), float(row["return in its simulator"])
    assert robot == pytest.approx(np.mean(done.before))
    assert robot == pytest.approx(twin, abs=0.02)
    logs = read_logs(tmp_path / "logs")
    assert [len(log) for log in logs] == [21, 21]
    assert logs[0].column("reward").sum() == pytest.approx(done.before[0])
    for name in ("returns", "log"):
        assert (tmp_path / "plots" / f"{name}.png").stat().st_size > 5000
    replay.run(log=str(tmp_path / "logs"), model=None, effects=None, out=tmp_path / "replay")
    assert json.loads((tmp_path / "replay" / "replay.json").read_text())["rmse"] < 0.015


@pytest.mark.parametrize("algorithm", ["es", "ppo"])
def test_the_robot_is_the_one_environment_that_is_built(algorithm, run, tmp_path, monkeypatch):
    """Once the policy is loaded: for all episodes, with whatever parameters, and no other."""
    policy = run if algorithm == "es" else train(tmp_path / "run", SMALL_PPO)
    load, tell, driven = verb.load_trained, verb.report, []
    built = note_worlds(monkeypatch)

    def loaded(*arguments: Any) -> Any:
        trained = load(*arguments)
        built.clear()  # those that training would use
        return trained

    def told(*arguments: Any) -> Any:
        driven.extend(built)
        return tell(*arguments)

    monkeypatch.setattr(verb, "load_trained", loaded)
    monkeypatch.setattr(verb, "report", told)
    done = go(policy, tmp_path / "out", "adapt=hillclimb", "adapt.queries=1", "adapt.sigma=0.3")
    assert done.done == 6
    assert [type(one) for one in driven] == [HardwareEnv]


def test_it_adapts_episode_by_episode(run, tmp_path):
    """The budget is the operator's; before and after start alike; the result is the best tried."""
    done = go(run, tmp_path, *CLIMB)
    assert (len(done.before), len(done.adapting), len(done.after)) == (2, 4, 2)
    phases = [row["phase"] for row in csv.DictReader((tmp_path / "returns.csv").open())]
    assert phases == ["as trained"] * 2 + ["adapting"] * 4 + ["adapted"] * 2
    logs = read_logs(tmp_path / "logs")
    assert ["policy" in log.meta for log in logs] == [True] * 2 + [False] * 6
    start = [log.column("qpos.hinge")[0] for log in logs]
    np.testing.assert_allclose(start[:2], start[-2:], atol=0.01)
    changed = not np.array_equal(done.session.result, done.theta)
    assert changed == (max(done.adapting[1:]) > done.adapting[0])
    assert "after 4 episodes of adaptation" in (tmp_path / "table.md").read_text()


@pytest.mark.slow
def test_a_policy_is_deployed_with_the_adaptation_that_it_was_trained_for(tmp_path, caplog):
    """Without adapt= the run's own operator is used; another one is told, and both say its cost."""
    caplog.set_level(logging.INFO)
    words = [*SMALL_ES, "adapt=hillclimb", "adapt.queries=1", "adapt.sigma=0.3"]
    climber = train(tmp_path / "run", words)
    assert "adaptation during training: sequential hill climbing, 2 episodes" in caplog.text
    save(compose(words), climber)
    done = go(climber, tmp_path / "own")
    assert len(done.adapting) == 2
    assert "6 episodes in all; adapts by sequential hill climbing, 2 episodes" in caplog.text
    assert "was trained for" not in caplog.text
    done = go(climber, tmp_path / "other", "adapt=batch")
    assert len(done.adapting) == 3
    assert "was trained for sequential hill climbing, 2 episodes" in caplog.text


@pytest.mark.slow
def test_what_was_interrupted_goes_on_as_if_it_had_not_been(run, tmp_path, monkeypatch):
    """Ctrl-C in the middle of adapting: torque off, a sentence; resumed, the same returns."""
    whole = go(run, tmp_path / "whole", *CLIMB)
    play, count = deploy.play, iter(range(100))

    def interrupted(*arguments: Any) -> Any:
        if next(count) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return play(*arguments)

    monkeypatch.setattr(deploy, "play", interrupted)
    with pytest.raises(
        RunInterrupted, match=r"after 4 of 8 episodes, torque is off; continue with"
    ):
        go(run, tmp_path / "part", *CLIMB)
    monkeypatch.setattr(deploy, "play", play)
    again = go(run, tmp_path / "rest", *CLIMB, f"resume={tmp_path / 'part'}")
    assert again.before == whole.before
    np.testing.assert_array_equal(again.session.ask() is None, whole.session.ask() is None)
    assert again.adapting[:2] == whole.adapting[:2]
    np.testing.assert_allclose(again.adapting, whole.adapting, atol=0.01)
    assert len(read_logs(tmp_path / "rest" / "logs")) == 4


def test_a_state_that_does_not_fit_is_refused(run, tmp_path):
    """Another number of episodes, another adaptation, another policy, and no state at all."""
    go(run, tmp_path / "a")
    for words in (["trials=3"], CLIMB):
        with pytest.raises(Sim2RealError, match="give the same trials= and adapt="):
            go(run, tmp_path / "b", f"resume={tmp_path / 'a'}", *words)
    other = train(tmp_path / "other", [*SMALL_ES, "seed=7"])
    with pytest.raises(Sim2RealError, match="used another policy"):
        go(other, tmp_path / "b", f"resume={tmp_path / 'a'}")
    (tmp_path / "a" / "state.npz").write_bytes(b"PK")
    with pytest.raises(Sim2RealError, match="deployment is incomplete or damaged"):
        go(run, tmp_path / "b", f"resume={tmp_path / 'a'}")


@pytest.mark.slow
def test_a_policy_of_ppo_adapts_too(tmp_path):
    """An actor's parameters are a vector as well; without change it is the actor itself."""
    run = train(tmp_path / "run", SMALL_PPO)
    done = go(run, tmp_path / "out", *CLIMB)
    assert (len(done.before), len(done.adapting), len(done.after)) == (2, 4, 2)
    (first, _) = csv.DictReader((tmp_path / "out" / "table.csv").open())
    robot, twin = float(first["return on the robot"]), float(first["return in its simulator"])
    assert robot == pytest.approx(twin, abs=0.02)


@pytest.mark.slow
def test_an_actor_with_a_memory_adapts_on_the_robot(tmp_path):
    """What evolution strategies trained with tensordict modules is driven like any other."""
    words = [*SMALL_ES, "policy=gru", "policy.memory.python_based=true"]
    done = go(train(tmp_path / "run", words), tmp_path / "out", *CLIMB)
    assert (len(done.before), len(done.adapting), len(done.after)) == (2, 4, 2)
    (first, _) = csv.DictReader((tmp_path / "out" / "table.csv").open())
    robot, twin = float(first["return on the robot"]), float(first["return in its simulator"])
    assert robot == pytest.approx(twin, abs=0.02)


@pytest.mark.slow
def test_a_policy_of_ppo_brings_its_normalizer(tmp_path, monkeypatch):
    """On the robot the network sees what it saw in training: mean and deviation taken out."""
    run = train(tmp_path / "run", SMALL_PPO)
    learner = run_verb(SMALL_PPO, tmp_path / "again")  # the same seed gives the same policy
    taken, pairs = RowsEnv.taken, []

    def noted(self: RowsEnv, tensordict: TensorDictBase) -> np.ndarray:
        done = taken(self, tensordict)
        pairs.append((self._last[0].copy(), done[0]))
        return done

    monkeypatch.setattr(RowsEnv, "taken", noted)
    go(run, tmp_path / "out", "adapt=none")
    assert len(pairs) == 2 * 2 * 20  # two episodes on the robot, and the same in its simulator
    seen, done = (np.array(values) for values in zip(*pairs, strict=True))
    inside = affine(learner.collecting.env)
    assert inside is not None
    mean, std = inside
    network, (_, low, high) = (
        learner.policy.actor[0].module[0],
        learner.parts.environment.observation_and_action_spec(),
    )
    bare = Actor(network, np.zeros_like(mean), np.ones_like(std), low, high)
    with torch.no_grad():
        wanted, raw = (bare(torch.from_numpy(x)).numpy() for x in ((seen - mean) / std, seen))
    np.testing.assert_allclose(done, wanted, atol=1e-6)
    assert np.abs(done - raw).max() > 1e-3


def test_what_cannot_be_is_refused_before_torque(run, tmp_path):
    """Another robot's policy or calibration, a slow bus, a missing servo, a robot not armed."""
    with pytest.raises(RobotError, match=r"task of the robot 'bench1'.*'quad8'"):
        go(run, tmp_path, "robot=quad8")
    write_calibration(tmp_path / "c.json", calibration_of(load_robot("hopper2")))
    with pytest.raises(RobotError, match="made on 'hopper2', not on 'bench1'"):
        go(run, tmp_path, f"calibration={tmp_path / 'c.json'}")
    with pytest.raises(RobotError, match=r"rate 100, but the task runs 50"):
        go(run, tmp_path, robot=bench(rate=100.0))
    slow = {"baud": 57600, "return_delay": 0.0005, "latency": 0.016}
    with pytest.raises(ServoError, match=r"at most \d+ steps per second, not 50; raise bus.baud"):
        go(run, tmp_path, robot=bench(bus=slow))
    with pytest.raises(Sim2RealError, match=r"bench1 at /dev/x would move; clear .* arm=true"):
        go(run, tmp_path, "port=/dev/x")
    with pytest.raises(Sim2RealError, match="expected one trained policy, none was given"):
        go(run, tmp_path, "env=hopper", checkpoint=None)
    with pytest.raises(Sim2RealError, match="settle=-1"):
        go(run, tmp_path, settle=-1.0)
    with pytest.raises(Sim2RealError, match="trials=0 must be at least 1"):
        go(run, tmp_path, trials=0)
    assert not (tmp_path / "logs").exists()


def test_a_policy_for_no_servo_robot_is_refused(run, tmp_path):
    """A Hopper of Gymnasium has no servos, a toy has not even a task."""
    for env, message in (
        ("hopper", "Hopper is not a task of a servo robot"),
        ("nav2d", "does not simulate a robot"),
    ):
        with pytest.raises(Sim2RealError, match=message):
            go(run, tmp_path, f"env={env}")


def test_a_dry_run_sends_nothing_and_does_not_adapt(run, tmp_path):
    """The policy is computed on a robot that stays limp."""
    done = go(run, tmp_path, *CLIMB, "dry_run=true")
    assert (len(done.before), done.adapts) == (2, False)
    (log, _) = read_logs(tmp_path / "logs")
    assert np.ptp(log.column("qpos.hinge")) < 0.01
    assert np.ptp(log.column("action.hinge")) > 0.05


def test_a_robot_that_is_stopped_says_why_and_how_to_go_on(run, tmp_path):
    """A hidden effect that no guard allows: torque off, the reason, what is on disk stays."""
    hidden = tmp_path / "effects.yaml"
    hidden.write_text("- {effect: supply_voltage, where: null, value: 0.75}\n")
    with pytest.raises(SafetyError, match=r"V, not 5\.0 V"):
        go(run, tmp_path / "out", f"robot.hidden={hidden}")
    assert (tmp_path / "out" / "state.npz").exists()
    done = go(run, tmp_path / "out", f"robot.hidden={hidden}", "stops={odd_voltage: 0.5}")
    assert len(done.before) == 2
    with pytest.raises(Sim2RealError, match=r"stops\.odd_volt=0\.5 \(did you mean 'odd_voltage'"):
        go(run, tmp_path / "out", "stops={odd_volt: 0.5}")
    with pytest.raises(
        Sim2RealError, match=r"stops\.lost=5 is a fraction; expected above 0 and at most 1"
    ):
        go(run, tmp_path / "out", "stops={lost: 5}")


def test_results_are_told_even_if_parking_fails(run, tmp_path, monkeypatch):
    """All episodes are done: the table is written, the reason raised; resumed, nothing moves."""
    close = RobotRows.close

    def stuck(rows: RobotRows) -> None:
        close(rows)
        raise SafetyError("hinge is stuck")

    monkeypatch.setattr(RobotRows, "close", stuck)
    with pytest.raises(SafetyError, match="hinge is stuck"):
        go(run, tmp_path)
    table = (tmp_path / "table.md").read_text()
    assert (tmp_path / "plots" / "returns.png").exists()
    monkeypatch.setattr(RobotRows, "arm", lambda rows: pytest.fail("it was armed"))
    (tmp_path / "table.md").unlink()
    assert len(go(run, tmp_path, f"resume={tmp_path}").before) == 2
    assert (tmp_path / "table.md").read_text() == table


def test_a_log_tells_what_it_is_of(run, tmp_path):
    """Robot, task, settings, counters, jitter and missed deadlines stand beside each log.

    Its link does as well, and that of all episodes in link.json.
    """
    go(run, tmp_path)
    meta = json.loads((tmp_path / "logs" / "episode-0001.json").read_text())
    assert (meta["robot"], meta["task"], meta["rate"], meta["missed"]) == (
        "bench1",
        "Bench1",
        50,
        0,
    )
    assert meta["settings"]["hinge"]["position_p_gain"] == 800
    assert meta["counters"]["hinge"]["timeout"] == 0
    assert meta["jitter"]["max"] < 1e-6
    whole = json.loads((tmp_path / "link.json").read_text())
    logs = [json.loads(path.read_text())["link"] for path in (tmp_path / "logs").glob("*.json")]
    assert whole["period"] == pytest.approx({"p50": 0.02, "p90": 0.02, "p99": 0.02})
    assert (whole["overruns"], whole["score"]) == (0, None)
    assert whole["periods"] == sum(log["periods"] for log in logs) > 0
    asked = sum(log["servos"]["hinge"]["asked"] for log in logs)
    assert whole["servos"]["hinge"] == {"asked": asked, "lost": 0, "late": 0, "stale": 0}


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [["adapt=policy_gradient", "adapt.trajectories=3"], ["adapt=ppo", "adapt.rounds=3"]]
)
def test_a_policy_adapts_by_its_steps_on_the_robot(tmp_path, monkeypatch, words):
    """Three episodes with drawn actions change it; what was interrupted ends alike."""
    run = train(tmp_path / "run", SMALL_PPO)
    whole = go(run, tmp_path / "whole", *words)
    assert (len(whole.before), len(whole.adapting), len(whole.after)) == (2, 3, 2)
    assert len(set(whole.adapting)) == 3 and not np.array_equal(whole.session.result, whole.theta)
    play, count = deploy.play, iter(range(100))

    def interrupted(*arguments: Any) -> Any:
        if next(count) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return play(*arguments)

    monkeypatch.setattr(deploy, "play", interrupted)
    with pytest.raises(
        RunInterrupted, match=r"after 4 of 7 episodes, torque is off; continue with"
    ):
        go(run, tmp_path / "part", *words)
    monkeypatch.setattr(deploy, "play", play)
    again = go(run, tmp_path / "rest", *words, f"resume={tmp_path / 'part'}")
    assert again.adapting[:2] == whole.adapting[:2]
    np.testing.assert_allclose(again.session.result, whole.session.result, atol=0.02)
