"""Keys that no file writes out are set without Hydra's plus where their reader knows them."""

from pathlib import Path

import pytest
import yaml

from hardware.config import make_robot
from hardware.errors import RobotError
from sim2real.__main__ import precheck, readable
from sim2real.config.compose import compose
from sim2real.config.optional_keys import with_plus
from sim2real.config.targets import ConfigError

RECORD = ["run=record", "robot=hopper2"]


@pytest.mark.parametrize(
    ("choice", "line"),
    [
        ("robot=hopper2", "robot.servos.hip.sign=-1"),
        ("robot=quad8", "robot.imu.port=/dev/ttyUSB1"),
        ("robot=quad8", "robot.imu.emulated.latency=0.01"),
        ("robot=hopper2", "robot.supply.resistance=0.2"),
        ("robot=bench1", "stops.stray=2.0"),
        ("params=mass_friction", "params.draws.1.how=set"),
        ("params=mass_friction", "params.draws.1.distribution=ends"),
        ("params=goals", "params.return_noise=0.5"),
    ],
)
def test_a_key_that_is_left_out_gets_a_plus(choice: str, line: str) -> None:
    """A robot's, a guard's, a draw's, and that of a class."""
    given = [choice, line]
    assert with_plus(given, given) == [choice, f"+{line}"]


@pytest.mark.parametrize(
    "line",
    [
        "robot.watchdog=0.2",
        "robot.port=/dev/ttyUSB0",
        "params.draws.1.low=1.6",
        "+params.draws.1.how=set",
        "~params.draws.1.low",
        "params.draws.9.how=set",
        "policy.initail=zero",
        "env.num_envs=8",
        "env.seed=3",
        "transforms.stak=1",
        "eval.robots.mine.domain=source",
        "algoritm.sigma=1",
        "hydra.run.dir=out",
        "seed=1",
    ],
)
def test_any_other_stays(line: str) -> None:
    """What a file writes out, what has its plus, what no class knows, what the program gives."""
    given = ["params=mass_friction", "policy=linear", line]
    assert with_plus(given, given) == given


def test_the_value_arrives() -> None:
    """Beside a key that is written out; the robot that it makes has both."""
    tree = compose([*RECORD, "robot.servos.hip.sign=-1", "robot.max_step=0.5"])
    robot = make_robot(tree["robot"])
    assert [servo.sign for servo in robot.servos] == [-1, 1]
    assert robot.max_step == 0.5
    draws = compose(["params=mass_friction", "params.draws.1.friction_mode=seed"])["params"]
    assert draws["draws"][1]["friction_mode"] == "seed"


def test_an_unknown_name_is_refused_by_its_reader() -> None:
    """A robot's key that is in no class is named, with the nearest."""
    tree = compose([*RECORD, "robot.servos.hip.sgin=-1"])
    with pytest.raises(RobotError, match=r"unknown key 'sgin'.*did you mean 'sign'"):
        make_robot(tree["robot"])
    with pytest.raises(ConfigError, match=r"policy\.initial=0: expected one of normal, zero"):
        compose(["policy.initial=0"])


def test_of_a_sweep_and_of_what_is_shown() -> None:
    """Every job of a sweep gets the key; `--cfg job` shows it."""
    swept = "robot.servos.hip.sign=1,-1"
    assert precheck(readable(["-m", *RECORD, swept])) == ["-m", *RECORD, f"+{swept}"]
    shown = precheck(readable(["record", "hopper2", swept[:-3], "--cfg", "job"]))
    assert shown == ["--cfg", "job", *RECORD, f"+{swept[:-3]}"]


def test_of_a_run_from_before_its_file_left_the_key_out(tmp_path: Path) -> None:
    """What a saved run was given is composed again, without a plus in its overrides."""
    (tmp_path / ".hydra").mkdir()
    (tmp_path / "checkpoints").mkdir()
    lines = ["params=mass_friction", "params.draws.1.how=set"]
    (tmp_path / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump(lines))
    tree = compose(["run=evaluate", f"checkpoint={tmp_path}"])
    assert tree["params"]["draws"][1]["how"] == "set"
