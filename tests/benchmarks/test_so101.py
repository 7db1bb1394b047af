"""The real arm's figures: errors over joints and logs, the share that closes, and the table."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks import so101
from benchmarks.so101 import ARM, FIT, HELD_OUT, closed, overall, report
from envs.effects import make, write_effects
from hardware.log import Log
from sim2real.runs.statistics import Interval


def test_nothing_is_held_out_that_was_fitted() -> None:
    """Fourteen logs, four of them fitted."""
    assert not set(FIT) & set(HELD_OUT)
    assert (len(FIT), len(HELD_OUT)) == (4, 10)


def test_what_is_closed() -> None:
    """From 5 to 2 over a floor of 1: three quarters, the same in every log."""
    before, after, floor = (np.full((6, 2), value) for value in (5.0, 2.0, 1.0))
    assert overall(np.array([[3.0, 4.0], [0.0, 5.0]])) == pytest.approx(np.sqrt(12.5))
    assert closed(before, after, floor) == pytest.approx((0.75, 0.75, 0.75))


def test_the_report_has_joints_causes_and_logs(tmp_path: Path, monkeypatch) -> None:
    """Degrees, before and after, with what was found and what is left."""
    ones = np.ones((len(HELD_OUT), len(ARM)))
    parts = tuple(np.radians(value) * ones for value in (2.0, 0.6, 0.2, 0.5))
    monkeypatch.setattr(so101, "replayed", lambda data, out: (*parts, 0.9))
    cause = {"effect": "position_gain", "where": "elbow_flex", "value": 0.011, "unit": ""}
    cause |= {"value_ci": [0.01, 0.012], "closed": 0.7, "equivalent": []}
    answer = {"verdict": "partly_explained", "gap": {"before": 0.035, "after": 0.01}}
    answer |= {"causes": [cause], "unexplained": {"structure": "slow"}}
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    write_effects(folder / "effects.yaml", [(make("position_gain", where="elbow_flex"), (0.011,))])
    (folder / "report.json").write_text(json.dumps(answer))
    table = report(tmp_path, tmp_path, tmp_path / "results")
    everything = table.rows[-1]
    assert everything[0] == "all five"
    assert everything[1:4] == pytest.approx((2.0, 0.6, 0.2))
    share = everything[4]
    assert isinstance(share, Interval)
    assert share.value == pytest.approx(1.4 / 1.8)
    page = (tmp_path / "results" / "so101.md").read_text()
    assert (
        "What is left: slow." in page
        and "| position_gain | elbow_flex | 0.011 [0.01, 0.012] |" in page
    )
    assert "In 10% of them the gripper is more than 2 cm below" in page
    assert "In the others 0.50 degrees are left." in page
    assert (tmp_path / "results" / "so101.png").is_file()


def test_where_the_gripper_is_below_its_base() -> None:
    """The lift tips an arm of 0.3 m: level it is at the base's height, at 6 degrees 3 cm below."""
    spec = mujoco.MjSpec()
    body = spec.worldbody
    for joint in ARM:
        body = body.add_body()
        body.add_joint(name=joint, axis=[0, 1, 0] if joint == "shoulder_lift" else [0, 0, 1])
        body.add_geom(size=[0.01, 0.01, 0.01], mass=0.1)
    body.add_site(name=so101.TIP, pos=[0.3, 0.0, 0.0])
    lift = np.radians([-30.0, 0.0, 3.0, 6.0])
    columns = {f"{kind}.{joint}": np.zeros(4) for kind in ("ctrl", "qpos") for joint in ARM}
    columns["qpos.shoulder_lift"] = lift
    log = Log({"episode": np.zeros(4), "time": np.arange(4.0), **columns}, {}, None)
    assert so101.in_the_air(log, spec.compile()).tolist() == [True, True, True, False]
