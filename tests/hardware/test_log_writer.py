"""Rows are on disk as they come: whatever ends the program, a reader finds them."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hardware.errors import LogError
from hardware.log import Log, read_log, read_logs, write_log
from hardware.log_writer import LogWriter

RECORD = """
import os, numpy as np
from pathlib import Path
from hardware.config import load_robot
from hardware.connect import make_driver
from hardware.record import Recording
from hardware.safety import Guard
driver = make_driver(load_robot("bench1"))
driver.connect(); driver.configure()
class Killed(Recording):
    def _step(self, wanted, torque, on):
        if len(self) == 40:
            os.kill(os.getpid(), 9)
        super()._step(wanted, torque, on)
with Guard(driver) as guard:
    guard.arm()
    Killed(guard, path=Path("{folder}/log.csv")).drive(np.zeros((100, 1)))
"""
EPISODE = """
import os, numpy as np
from pathlib import Path
from envs.tasks.servo import Bench1
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.rows import RobotRows
rows = RobotRows(Bench1(), ServoBackend(load_robot("bench1"), settle=0.1), Path("{folder}"))
rows.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64))
for _ in range(41):
    rows.step(None, np.zeros((1, 1)))
os.kill(os.getpid(), 9)
"""


def row(k: int) -> dict[str, float]:
    """Return a row of a small log."""
    return {"episode": 0.0, "time": 0.02 * k, "ctrl.a": 0.1, "qpos.a": k / 3, "flag.fresh": 1.0}


@pytest.mark.parametrize("program", [RECORD, EPISODE], ids=["record", "deploy"])
def test_a_killed_program_leaves_its_rows(tmp_path, caplog, program):
    """Kill -9 after 40 rows: the 40 are read, with a note, from the file or its folder."""
    done = subprocess.run([sys.executable, "-c", program.replace("{folder}", str(tmp_path))])
    assert done.returncode == -signal.SIGKILL
    (part,) = tmp_path.glob("*.csv.part")
    log = read_log(part)
    assert len(log) == 40
    assert "its program was ended before it was whole; 40 rows" in caplog.text
    assert log.meta["robot"] == "bench1"
    assert "before it could close" in log.meta["stopped"]
    assert log.model is not None and log.model.is_file()
    (same,) = read_logs(tmp_path)
    np.testing.assert_array_equal(same.time, log.time)


def test_row_by_row_is_what_a_log_writes_at_once(tmp_path):
    """The same bytes and metadata, under the whole name, and nothing beside them."""
    writer = LogWriter(tmp_path / "rows.csv", {"robot": "r"})
    rows = [row(k) for k in range(5)]
    for each in rows:
        writer.add(each)
    assert writer.close({"robot": "r", "stopped": "Ctrl-C"})
    columns = {name: np.array([each[name] for each in rows]) for name in rows[0]}
    write_log(tmp_path / "once.csv", Log(columns, {"robot": "r", "stopped": "Ctrl-C"}))
    for ending in (".csv", ".json"):
        found = [(tmp_path / f"{name}{ending}").read_bytes() for name in ("rows", "once")]
        assert found[0] == found[1]
    assert sorted(os.listdir(tmp_path)) == ["once.csv", "once.json", "rows.csv", "rows.json"]


def test_half_a_row_is_left_out(tmp_path):
    """A row that was being written when the power went is not read as a shorter number."""
    writer = LogWriter(tmp_path / "log.csv", {})
    for k in range(4):
        writer.add(row(k))
    part = tmp_path / "log.csv.part"
    whole = part.read_bytes()
    for cut in (1, 5, 10):
        part.write_bytes(whole[:-cut])
        np.testing.assert_array_equal(read_log(part).column("qpos.a"), [0.0, 1 / 3, 2 / 3])
    part.write_bytes(whole.splitlines(keepends=True)[0])
    with pytest.raises(LogError, match="no rows"):
        read_log(part)


def test_less_than_a_log_leaves_no_file(tmp_path):
    """One row is no log."""
    writer = LogWriter(tmp_path / "log.csv", {"robot": "r"})
    writer.add(row(0))
    assert json.loads((tmp_path / "log.json").read_text())["stopped"]
    assert not writer.close()
    assert not writer.close()
    assert list(tmp_path.iterdir()) == []


def test_a_killed_episode_is_not_written_over(tmp_path):
    """The next program numbers on behind what a killed one left."""
    from hardware.config import load_robot
    from hardware.episode_log import EpisodeLog

    Path(tmp_path / "episode-0003.csv.part").write_text("episode,time\n")
    assert EpisodeLog(load_robot("bench1"), tmp_path)._number == 4
