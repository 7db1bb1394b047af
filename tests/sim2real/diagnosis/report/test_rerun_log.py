"""A log for the Rerun viewer: what is written can be read back."""

import sys
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.data.replay import measure_all
from sim2real.diagnosis.report.rerun_log import write_rerun
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm

FRICTION = ("coulomb_friction", {"where": "b"}, 0.3)


def test_a_recording_holds_robot_ghost_and_joints(tmp_path: Path) -> None:
    """Bodies, shapes and positions, measured and simulated; the values are those of the replay."""
    reader = pytest.importorskip("rerun.chunk", reason="needs the extra 'viewer'")
    log = arm.make_log(FRICTION, seconds=2.0)
    (gap,) = measure_all([log], [arm.spec()])
    path = write_rerun(tmp_path / "log.rrd", {"model as given": [gap]}, arm.spec())
    chunks = reader.RrdReader(str(path)).stream().to_chunks()
    places = {chunk.entity_path.replace("\\", "") for chunk in chunks}
    assert {"/log/episode 0/robot/measured/lower", "/log/episode 0/joints/b/measured"} <= places
    (line,) = [
        chunk.to_record_batch()
        for chunk in chunks
        if chunk.entity_path.replace("\\", "").endswith("joints/b/model as given")
        and not chunk.is_static
    ]
    column = next(name for name in line.schema.names if "calar" in name)
    values = [row[0] for row in line.column(column).to_pylist()]
    np.testing.assert_allclose(values, gap.simulated[:, 1], atol=1e-9)


def test_without_the_package_its_extra_is_named(tmp_path: Path, monkeypatch) -> None:
    """Nothing is written."""
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.setattr("sim2real.diagnosis.report.rerun_log.find_spec", lambda name: None)
    with pytest.raises(Sim2RealError, match=r"sim2real\[viewer\]"):
        write_rerun(tmp_path / "log.rrd", {}, arm.spec())
    assert list(tmp_path.iterdir()) == []
