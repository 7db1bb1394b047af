"""A stranger's log in each format: converted and replayed by what messages say, as typed."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from hardware.log import Log
from tests.hardware.formats.recorded import JOINTS, lerobot, mcap, rosbag2, run

ROOT = Path(__file__).resolve().parents[3]
BODY = """<body name="{0}" pos="0 0 {1}"><joint name="{0}" axis="0 1 0" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass="0.2"/>"""
MODEL = f"""<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
{BODY.format("pan", 0)}{BODY.format("lift", -0.2)}</body></body></worldbody><actuator>
<position name="pan" joint="pan" kp="8" kv="0.4"/>
<position name="lift" joint="lift" kp="6" kv="0.3"/></actuator></mujoco>"""


def typed(folder: Path, *lines: str) -> list[str]:
    """Run command lines of `sim2real` in a folder, one after the other; return what each said."""
    said = []
    for line in lines:
        done = subprocess.run(
            [sys.executable, "-m", "sim2real", *line.split()],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert "Traceback" not in done.stdout, done.stdout
        said.append(done.stdout)
    return said


def plotjuggler(folder: Path, log: Log) -> Path:
    """Write a CSV of ROS 2 topics as PlotJuggler exports it: Unix seconds, one column a field."""
    columns = {"__time": [f"{t + 1.7e9:.6f}" for t in log.time]}
    for joint in log.joints:
        columns[f"/joint_commands/{joint}/position"] = log.column(f"ctrl.{joint}").tolist()
        columns[f"/joint_states/{joint}/position"] = log.column(f"qpos.{joint}").tolist()
        columns[f"/joint_states/{joint}/velocity"] = log.column(f"qvel.{joint}").tolist()
    return table(folder / "run.csv", columns)


def rosbag_csv(folder: Path, log: Log) -> Path:
    """Write a CSV of two topics as they came: a row for each message, empty cells in the others."""
    written = plotjuggler(folder, log)
    head, *rows = written.read_text().splitlines()
    commands = [name.startswith("/joint_commands") for name in head.split(",")]
    lines = [head]
    for row, text in enumerate(rows):
        time, *cells = text.split(",")
        state = ["" if own else cell for own, cell in zip(commands[1:], cells, strict=True)]
        sent = [cell if own else "" for own, cell in zip(commands[1:], cells, strict=True)]
        lines.append(",".join([f"{float(time) - 0.003:.6f}", *state]))
        lines += [",".join([time, *sent])] * (row % 2 == 0)  # states at 50 Hz, commands at 25
    written.write_text("\n".join(lines) + "\n")
    return written


def pandas(folder: Path, log: Log) -> Path:
    """Write what `DataFrame.to_csv` does: an index, dates, degrees, a lost reading."""
    columns: dict[str, list] = {"": list(range(len(log)))}
    columns["timestamp"] = [f"2026-01-15 10:00:{t:09.6f}" for t in log.time]
    for joint in log.joints:
        columns[f"{joint}_cmd_deg"] = np.degrees(log.column(f"ctrl.{joint}")).tolist()
        columns[f"{joint}_pos_deg"] = np.degrees(log.column(f"qpos.{joint}")).tolist()
    columns["pan_pos_deg"][20] = ""
    return table(folder / "run.csv", columns)


def lerobot_v21(folder: Path, log: Log) -> Path:
    """Write a LeRobot data set of version 2.1: a file an episode."""
    path = lerobot(folder, log)
    file = path / "data" / "chunk-000" / "file-000.parquet"
    file.rename(file.with_name("episode_000000.parquet"))
    info = json.loads((path / "meta" / "info.json").read_text())
    (path / "meta" / "info.json").write_text(json.dumps(info | {"codebase_version": "v2.1"}))
    return path


def bam(folder: Path, log: Log) -> Path:
    """Write a run of BAM's bench; its joint is `hinge`."""
    told = zip(log.time, log.column("ctrl.pan"), log.column("qpos.pan"), strict=True)
    entries = [
        {"timestamp": t, "goal_position": c, "position": q, "torque_enable": True}
        for t, c, q in ((float(t), float(c), float(q)) for t, c, q in told)
    ]
    table = {"mass": 0.5, "length": 0.1, "kp": 100, "vin": 7.4, "motor": "xl330"}
    path = folder / "run.json"
    path.write_text(json.dumps({**table, "entries": entries}))
    return path


def sage(folder: Path, log: Log) -> Path:
    """Write a motion of SAGE: two files, and the joints' names."""
    path = folder / "motion"
    path.mkdir()
    for kind, name in (("ctrl", "control"), ("qpos", "state_motor")):
        lines = ["type,timestamp,positions"]
        for row, time in enumerate(log.time):
            values = [float(log.column(f"{kind}.{joint}")[row]) for joint in JOINTS]
            lines.append(f'{name.upper()},{round(1e6 * float(time))},"{values}"')
        (path / f"{name}.csv").write_text("\n".join(lines))
    (path / "joint_list.txt").write_text("\n".join(JOINTS))
    return path


def table(path: Path, columns: dict[str, list]) -> Path:
    """Write a CSV."""
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def without_mapping(write: Callable[[Path, Log], Path]) -> Callable[[Path, Log], Path]:
    """Write a recording of messages without its topics.yaml, as a stranger has it."""

    def written(folder: Path, log: Log) -> Path:
        path = write(folder, log)
        for file in folder.rglob("topics.yaml"):
            file.unlink()
        return path

    return written


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("write", [plotjuggler, rosbag_csv, pandas])
def test_a_table_is_mapped_by_its_guess(write: Callable[[Path, Log], Path], tmp_path: Path) -> None:
    """Refused with the command that writes a mapping; with it, it is replayed and converted."""
    (tmp_path / "arm.xml").write_text(MODEL)
    log = run()
    write(tmp_path, log)
    refused, guessed, replayed, converted = typed(
        tmp_path,
        "replay run.csv arm.xml out=first",
        "convert run.csv columns=columns.yaml",
        "replay run.csv arm.xml out=second",
        "convert run.csv out=converted model=arm.xml",
    )
    assert "sim2real convert LOG columns=columns.yaml" in refused
    assert "wrote columns.yaml; read it over" in guessed
    assert "rmse" in replayed and "rmse" not in converted
    found = json.loads((tmp_path / "second" / "replay.json").read_text())
    assert set(found["logs"][0]["joints"]) == set(JOINTS)
    made = (tmp_path / "converted" / "run.csv").read_text().split("\n")
    assert set(made[0].split(",")) >= {"episode", "time", "ctrl.pan", "qpos.lift"}
    ours = json.loads((tmp_path / "converted" / "run.json").read_text())
    assert ours["model"].endswith("arm.xml")


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("write", [lerobot, lerobot_v21])
def test_a_data_set_of_lerobot_is_replayed(write: Callable[[Path, Log], Path], tmp_path) -> None:
    """As it is, since it says what its columns are."""
    (tmp_path / "arm.xml").write_text(MODEL)
    write(tmp_path / "set", run())
    replayed, converted = typed(
        tmp_path, "replay set arm.xml out=replay", "convert set out=converted model=arm.xml"
    )
    assert "rmse" in replayed and "results are in" in converted


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("write", "joints"), [(bam, ["hinge"]), (sage, list(JOINTS))])
def test_a_bench_s_and_an_arm_s_runs_are_converted(write, joints, tmp_path) -> None:
    """BAM's and SAGE's own files say what they hold; the names may be the model's."""
    (tmp_path / "arm.xml").write_text(MODEL)
    name = write(tmp_path, run()).name
    wanted = JOINTS[: len(joints)]
    converted, replayed = typed(
        tmp_path,
        f"convert {name} out=converted model=arm.xml joints=[{','.join(wanted)}]",
        "replay converted out=replay",
    )
    assert "results are in" in converted and "rmse" in replayed
    found = json.loads((tmp_path / "replay" / "replay.json").read_text())
    assert set(found["logs"][0]["joints"]) == set(wanted)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("write", [mcap, rosbag2])
def test_a_recording_of_messages_is_mapped_by_its_guess(write, tmp_path) -> None:
    """The guess knows the states; which topic commands which joints only its user does."""
    (tmp_path / "arm.xml").write_text(MODEL)
    path = without_mapping(write)(tmp_path, run())
    name = path.relative_to(tmp_path)
    refused, guessed = typed(
        tmp_path, f"replay {name} arm.xml out=first", f"convert {name} columns=topics.yaml"
    )
    assert f"sim2real convert {path.name} columns=topics.yaml" in refused
    assert "wrote topics.yaml; read it over" in guessed
    tree = yaml.safe_load((tmp_path / "topics.yaml").read_text())
    tree["channels"][0] |= {"topic": "/commands", "names": list(JOINTS)}
    (tmp_path / "topics.yaml").write_text(yaml.safe_dump(tree))
    (replayed,) = typed(tmp_path, f"replay {name} arm.xml out=second")
    assert "rmse" in replayed
