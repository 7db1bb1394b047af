"""The robots that people own, from a scan to torque off, on the emulator in virtual time."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from envs.effects import EFFECTS
from hardware.commands import main
from hardware.config import Robot, load_robot
from hardware.emulator.world import EmulatedRobot
from hardware.log import read_log
from hardware.nominal import write_nominal_model
from hardware.stand import write_stand_model
from tests.hardware.stand_ins import public_model
from tests.sim2real.trained import run_verb, train

DELAY = 0.03  # s
FRICTION = {  # which joint rubs, and how much [N·m]: a fifth of what its servo stalls at, or less
    "koch": ("base_rotation", 0.2),
    "so101": ("elbow_flex", 0.4),
    "leap_hand": ("rf_pip", 0.02),
    "open_duck_mini": ("left_knee", 0.4),
    "toddlerbot": ("right_hip_pitch", 0.4),
    "microduck": ("head_pitch", 0.06),
}
RIVALS = (  # what a diagnosis may name, at each joint: with every effect, 30 servos take hours
    *("command_delay", "observation_delay", "coulomb_friction", "viscous_friction"),
    "position_gain",
)
pytestmark = [pytest.mark.slow, pytest.mark.timeout(7200)]


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> list[EmulatedRobot]:
    """Return a list that gets every emulated robot of a test."""
    made, make = [], EmulatedRobot.__init__

    def remembered(self: EmulatedRobot, *args: Any, **kwargs: Any) -> None:
        make(self, *args, **kwargs)
        made.append(self)

    monkeypatch.setattr(EmulatedRobot, "__init__", remembered)
    return made


def go(out: Path, *words: str) -> Any:
    """Run a verb as the command line does."""
    return run_verb(list(words), out)


def hung(name: str, folder: Path) -> Robot:
    """Return the robot on a stand, its public model with its servos as actuators."""
    robot = load_robot(name, str(public_model(name, folder)))
    return write_stand_model(write_nominal_model(robot, folder / "nominal.xml"), folder)


@pytest.mark.parametrize("name", FRICTION)
def test_a_robot_is_scanned_recorded_diagnosed_and_driven(name, tmp_path, worlds, capsys) -> None:
    """A hidden delay and a friction are named with their sizes; a posture is held, then let go."""
    joint, friction = FRICTION[name]
    robot, hidden = hung(name, tmp_path), tmp_path / "hidden.yaml"
    effects = [{"effect": "command_delay", "where": None, "value": DELAY}]
    effects += [{"effect": "coulomb_friction", "where": joint, "value": friction}]
    hidden.write_text(yaml.safe_dump(effects))
    words = [f"robot={name}", f"robot.model={robot.model}"]

    assert main(["scan", f"robot={name}", f"model={robot.model}"]) == 0
    said = capsys.readouterr().out
    assert f"{name}: all {len(robot.servos)} servos match its file" in said

    record = ["run=record", "motions=[ramp,chirp]", "seconds=5", "size=0.4"]
    go(tmp_path / "record", *record, *words, f"robot.hidden={hidden}")
    log = tmp_path / "record" / "log.csv"
    assert np.ptp(read_log(log).column(f"qpos.{joint}")) > 0.1

    left_out = [name for name in EFFECTS if name not in RIVALS]
    go(tmp_path / "diagnose", "run=diagnose", f"log={log}", f"exclude=[{','.join(left_out)}]")
    report = json.loads((tmp_path / "diagnose" / "report.json").read_text())
    causes = {  # what these motions cannot tell apart counts as named
        (one["effect"], one["where"]): cause["value"]
        for cause in report["causes"]
        for one in (cause, *cause["equivalent"])
    }
    assert report["verdict"] in ("explained", "partly_explained")
    assert causes["command_delay", None] == pytest.approx(DELAY, abs=0.004)
    assert causes["coulomb_friction", joint] == pytest.approx(friction, rel=0.25)

    follow = ["env=follow", f"env.task.robot={name}", f"env.task.model={robot.model}"]
    follow += ["env.task.seconds=1.0", "algorithm=ppo", "iterations=1", "algorithm.num_rows=4"]
    follow += ["algorithm.steps=16", "algorithm.minibatch_size=32"]
    run = train(tmp_path / "train", follow)
    go(tmp_path / "deploy", "run=deploy", f"checkpoint={run}", *words, "trials=1", "settle=0.2")
    assert len(worlds) == 3
    assert not any(world.firmware.torque_on.any() for world in worlds)
    assert worlds[-1].firmware.time > 1.0
