"""One recorded run gives one diagnosis, whatever format it was recorded in."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from envs.effects import EFFECTS
from hardware.log import Log
from sim2real.diagnosis.diagnose import diagnose
from tests.hardware.formats.recorded import FORMATS, LATE
from tests.sim2real.diagnosis import arm

TRIED = ("coulomb_friction", "viscous_friction", "armature", "command_delay", "backlash")
SECONDS, FRICTION = 12.0, 0.15
TOLERANCE = 1e-6  # of a value
LACKING = {"lerobot": ("qvel", "stamp")}  # kinds of columns that a format cannot hold
Answer = tuple[tuple[str, str | None, float, tuple[float, float]], ...]


def recorded() -> Log:
    """Return a run of the arm whose joint b rubs: read a little before each command."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, FRICTION), seconds=SECONDS)
    columns, read = dict(log.columns), log.time - LATE
    for joint in arm.JOINTS:
        path = CubicSpline(log.time, log.column(f"qpos.{joint}"))
        columns |= {f"qpos.{joint}": path(read), f"qvel.{joint}": path(read, 1)}
        columns[f"stamp.{joint}"] = read
    kinds = ("episode", "time", "ctrl", "qpos", "qvel", "stamp")
    return Log({n: columns[n] for kind in kinds for n in columns if n.split(".")[0] == kind})


def answer(source: Path | Log, model: str) -> Answer:
    """Return the causes that are found, with their values and intervals."""
    left_out = [name for name in EFFECTS if name not in TRIED]
    logs = [source] if isinstance(source, Log) else source
    report = diagnose(logs, model, exclude=left_out)
    return tuple((c.effect, c.where, c.value, c.value_ci) for c in report.causes)


@cache
def wanted(folder: Path, lacking: tuple[str, ...]) -> Answer:
    """Return the answer to the run as it is in memory, without kinds of columns."""
    log = recorded()
    kept = {n: v for n, v in log.columns.items() if n.split(".")[0] not in lacking}
    return answer(Log(kept), arm.model(folder))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where the arm's model is."""
    return tmp_path_factory.mktemp("arm")


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", FORMATS)
def test_one_run_is_one_answer(name: str, folder: Path, tmp_path: Path) -> None:
    """From CSV to rosbag2 causes agree, and their values and intervals to 1e-6 of each."""
    found = answer(FORMATS[name](tmp_path, recorded()), arm.model(folder))
    expected = wanted(folder, LACKING.get(name, ()))
    assert found[0][:2] == ("coulomb_friction", "b")
    assert [cause[:2] for cause in found] == [cause[:2] for cause in expected]
    for one, other in zip(found, expected, strict=True):
        assert one[2] == pytest.approx(other[2], rel=TOLERANCE)
        assert np.asarray(one[3]) == pytest.approx(np.asarray(other[3]), rel=TOLERANCE)
