"""The verb record, on the emulated robot, and what replay makes of its logs."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from hardware.config import ROBOTS
from hardware.errors import LogError, RobotError, SafetyError
from hardware.log import read_log
from sim2real.config.folders import check_output_is_free
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs import record, replay

FRICTION = "- {effect: coulomb_friction, where: hinge, value: 0.03}\n"


def robot(**changes: Any) -> dict[str, Any]:
    """Return the bench as its file holds it, with changes."""
    return yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8")) | changes


def go(out: Path, **changes: Any) -> Path:
    """Record six seconds of the bench, and return the log's path."""
    given: dict[str, Any] = {
        "robot": robot(),
        "port": None,
        "calibration": None,
        "arm": False,
        "motions": ["ramp", "steps", "swing"],
        "seconds": 6.0,
        "size": 0.6,
        "stops": None,
        "leader": None,
        "leader_port": None,
        "leader_calibration": None,
        "leader_scale": [],
        "seed": 0,
        "out": out,
    }
    record.run(**(given | changes))
    return out / "log.csv"


def rmse(log: Path, out: Path, effects: Path | None = None) -> float:
    """Return the gap of a log [rad]."""
    replay.run(log=str(log), model=None, effects=effects and str(effects), out=out)
    return json.loads((out / "replay.json").read_text(encoding="utf-8"))["rmse"]


@pytest.mark.slow
def test_a_hidden_effect_is_a_gap_that_closes_once_it_is_known(tmp_path: Path) -> None:
    """Model and emulated robot agree to 15 mrad; hidden friction parts them; known, it does not."""
    hidden = tmp_path / "effects.yaml"
    hidden.write_text(FRICTION, encoding="utf-8")
    plain = go(tmp_path / "plain")
    rough = go(tmp_path / "rough", robot=robot(hidden=str(hidden)))
    assert rmse(plain, tmp_path / "a") < 0.015
    assert rmse(rough, tmp_path / "b") > 0.03
    assert rmse(rough, tmp_path / "c", hidden) < 0.015


@pytest.mark.slow
def test_a_seed_decides_the_motion(tmp_path: Path) -> None:
    """One seed gives one log, byte for byte; another seed another."""
    first, again, other = (
        go(tmp_path / name, seed=seed).read_bytes()
        for name, seed in zip("abc", (0, 0, 1), strict=True)
    )
    assert first == again != other
    log = read_log(tmp_path / "a" / "log.csv")
    assert 0 < log.column("torque.hinge").mean() < 1
    assert (tmp_path / "a" / "plots" / "log.png").stat().st_size > 5000


def test_what_cannot_be_done_is_said_before_anything_moves(tmp_path: Path) -> None:
    """A real robot that was not armed, an unknown motion, no time, and a robot without a name."""
    with pytest.raises(Sim2RealError, match="add arm=true"):
        go(tmp_path, port="/dev/ttyUSB0")
    with pytest.raises(RobotError, match="did you mean 'ramp'"):
        go(tmp_path, motions=["ramps"])
    with pytest.raises(Sim2RealError, match="seconds=0"):
        go(tmp_path, seconds=0)
    with pytest.raises(RobotError):
        go(tmp_path, robot={"model": "bench1.xml"})
    with pytest.raises(RobotError, match=r"bench1: port= is empty; give a port such as"):
        go(tmp_path, port="", arm=True)
    assert not (tmp_path / "log.csv").exists()


def test_the_rows_until_a_stop_are_kept(tmp_path: Path) -> None:
    """A motor that is far too weak gets stuck: the guard stops it, and the log ends there."""
    hidden = tmp_path / "effects.yaml"
    hidden.write_text("- {effect: motor_strength, where: hinge, value: 0.02}\n", encoding="utf-8")
    with pytest.raises(SafetyError, match=r"hinge is at .*: it is stuck"):
        go(tmp_path, robot=robot(hidden=str(hidden)))
    log = read_log(tmp_path / "log.csv")
    assert 20 < len(log) < 290
    assert "it is stuck" in log.meta["stopped"]


@pytest.mark.parametrize("name", ["quad8", pytest.param("bench1_bam", marks=pytest.mark.slow)])
def test_every_robot_is_recorded_as_the_verb_stands(tmp_path: Path, name: str) -> None:
    """Legs that cannot be let go, and a soft servo under a heavy load, are no reason to stop."""
    machine = yaml.safe_load((ROBOTS / f"{name}.yaml").read_text(encoding="utf-8"))
    standing = ["ramp", "chirp", "steps", "multisine", "hold", "swing"]
    log = read_log(go(tmp_path, robot=machine, motions=standing, seconds=9.0))
    assert len(log) >= 9 * machine["rate"]
    assert "stopped" not in log.meta


@pytest.mark.parametrize("name", ["log.csv", "log.csv.part"])
def test_a_log_is_not_written_over(tmp_path: Path, name: str, caplog: Any) -> None:
    """A second recording into a folder is refused before it connects; the first stays."""
    caplog.set_level("INFO")
    (tmp_path / name).write_text("somebody's rows\n")
    with pytest.raises(LogError, match=rf"{name} already exists; give another folder \(out=\)"):
        go(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {name}
    assert (tmp_path / name).read_text() == "somebody's rows\n"
    tree = {"run": {"_target_": "sim2real.verbs.record.run"}, "resume": None}
    with pytest.raises(LogError, match="already exists"):
        check_output_is_free(tmp_path, tree)
    assert "is emulated" not in caplog.text


def test_a_joint_outside_its_limits_is_led_back_first(tmp_path: Path, caplog: Any) -> None:
    """It hangs 0.19 rad outside: the first row finds it at the limit, where it was taken slowly."""
    caplog.set_level("INFO")
    servos = {"hinge": robot()["servos"]["hinge"] | {"position": [0.19, 1.5]}}
    log = read_log(go(tmp_path, robot=robot(servos=servos), motions=["ramp"], seconds=1.0))
    assert log.meta["emulated"] is True and "port" not in log.meta
    assert "bench1 is emulated: it has no port" in caplog.text
    assert log.column("ctrl.hinge")[0] == pytest.approx(0.19, abs=2e-3)
    assert log.column("qpos.hinge")[0] == pytest.approx(0.19, abs=0.05)  # it sags


def test_the_guard_s_limits_are_settings(tmp_path: Path) -> None:
    """`stops` is as in deploy: a wrong name is refused, a strict limit stops the recording."""
    with pytest.raises(Sim2RealError, match=r"stops\.return_tim=9 \(did you mean 'return_time'"):
        go(tmp_path / "a", stops={"return_tim": 9})
    with pytest.raises(SafetyError, match=r"hinge is at \d+ °C; let it cool"):
        go(tmp_path / "b", stops={"hottest": 60.0})


def follow(tmp_path: Path, **changes: Any) -> Path:
    """Record an emulated arm that follows a leader with other zeros; return the log's path."""
    arm = yaml.safe_load((ROBOTS / "arm2.yaml").read_text(encoding="utf-8"))
    servos = {name: each | {"zero": 1900, "sign": -1} for name, each in arm["servos"].items()}
    leader = tmp_path / "my_leader.yaml"
    leader.write_text(yaml.safe_dump(arm | {"name": "lead", "model": None, "servos": servos}))
    given = {"robot": arm, "leader": str(leader), "motions": ["ramp"], "seconds": 3.0}
    return go(tmp_path / "out", **(given | changes))


def test_a_follower_is_recorded(tmp_path: Path) -> None:
    """Without ports an emulated person moves the leader; its model is the follower's."""
    log = read_log(follow(tmp_path))
    assert len(log) == 150
    assert "stopped" not in log.meta
    for name in ("shoulder", "elbow"):
        wanted, measured = log.column(f"action.{name}"), log.column(f"qpos.{name}")
        assert abs(wanted).max() > 0.5
        assert abs(wanted - measured).max() < 0.3


def test_a_leader_that_cannot_be_followed(tmp_path: Path) -> None:
    """Other joints, one of both emulated, one port for both: said before anything moves."""
    with pytest.raises(
        RobotError, match="the leader so101 has different joints from arm2: 'should"
    ):
        follow(tmp_path, leader="so101")
    with pytest.raises(Sim2RealError, match="lead is emulated and arm2 is /dev/x: give leader_p"):
        follow(tmp_path, port="/dev/x", arm=True)
    with pytest.raises(Sim2RealError, match="both have the port /dev/x; give each its own"):
        follow(tmp_path, port="/dev/x", leader_port="/dev/x", arm=True)
    with pytest.raises(Sim2RealError, match="add arm=true"):
        follow(tmp_path, port="/dev/x", leader_port="/dev/y")
    with pytest.raises(RobotError, match="lead: port= is empty"):
        follow(tmp_path, leader_port="")
    assert not (tmp_path / "out" / "log.csv").exists()
