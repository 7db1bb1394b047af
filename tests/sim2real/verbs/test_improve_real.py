"""The loop on a robot behind a serial port, in real time: asked before it moves, gone on with."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.config import load_robot
from hardware.connect import make_driver
from hardware.errors import HardwareError
from hardware.log import read_logs
from sim2real.loops.improve.improve import Improvement
from tests.hardware.test_main import emulated
from tests.sim2real.trained import train
from tests.sim2real.verbs.test_improve import POLICY, diagnosed, go, hidden

__all__ = ["diagnosed"]  # a fixture
# a busy machine is no reason to stop, nor not to arm
PATIENT = "stops={misses: 50, patience: 5.0, stray: 2.0, lost: 1.0, stale: 1.0}"
TRIES = 6
pytestmark = pytest.mark.slow


def answers(monkeypatch: pytest.MonkeyPatch, said: Iterator[str]) -> list[str]:
    """Let an operator say these; return the list that the questions go to."""
    asked: list[str] = []

    def ask(question: str) -> str:
        asked.append(question)
        return next(said)

    monkeypatch.setattr("builtins.input", ask)
    return asked


def test_a_real_robot_is_asked_about_and_gone_on_with(tmp_path, diagnosed, monkeypatch) -> None:
    """Yes, then no: one deployment and its results; resumed, the rest; torque is off each time."""
    run = train(tmp_path / "run", POLICY)
    robot = ["robot.watchdog=2.54", "arm=true", PATIENT, "rounds=1", "tolerance=0"]
    concealed = hidden(tmp_path).removeprefix("robot.")
    with emulated("robot=bench1", concealed) as (device, _):

        def loop(out: Path, *said: str) -> tuple[Improvement, list[str]]:
            """Go on as an operator does whose machine was too busy."""
            for _ in range(TRIES):
                asked = answers(monkeypatch, iter(said))
                more = [f"resume={out}"] if (out / "round_0").exists() else []
                try:
                    done = go(run, out, f"port={device}", *robot, *more)
                except (HardwareError, StopIteration) as error:
                    last = str(error)
                    continue
                if done.end != "stopped":
                    return done, asked
                last = done.why
            raise AssertionError(last)

        out = tmp_path / "out"
        done, asked = loop(out, "y", "n")
        assert done.end == "declined"
        assert done.story.rounds[0].robot is not None and len(done.story.rounds) == 1
        assert f"bench1 at {device} will be driven along two recordings" in asked[-1]
        assert not (out / "round_1" / "stand").exists()
        before = done.story.rounds[0].robot
        done, asked = loop(out, *"yyyy")
        assert asked[-1].startswith(f"bench1 at {device} will run ")
        assert "the policy of round_1" in asked[-1]
        assert done.story.rounds[0].robot == before  # nothing of it is done again
        assert done.end in ("rounds", "within_noise", "no_gain")
        assert len(done.story.rounds[1].robot or []) == 2
        assert off(device)
    logs = read_logs(out / "round_1" / "deploy" / "logs")
    assert np.ptp(logs[0].column("qpos.hinge")) > 0.1
    assert len(diagnosed) == 1


def off(device: str) -> bool:
    """Return whether the servo at a device has no torque."""
    driver = make_driver(replace(load_robot("bench1"), port=device))
    try:
        driver.connect()
        health = next(h for _ in range(20) if (h := driver.health(0)) is not None)
        return not health.torque
    finally:
        driver.close()
