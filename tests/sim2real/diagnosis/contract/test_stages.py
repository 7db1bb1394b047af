"""Commands that hardly move, and that are rounded to counts, show faults of their own alone."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.contract.decode import decode
from sim2real.diagnosis.contract.rebuild import Variant
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.stages import Stage, check_action
from sim2real.diagnosis.contract.ways import Target
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis.contract.walk import (
    JOINTS,
    POSE,
    SCALE,
    described,
    older,
)

COUNT = 2 * np.pi / 4096  # rad
ROWS = 300


def commands(path: Path, action: np.ndarray, sent: np.ndarray, limited: np.ndarray) -> Stage:
    """Check commands (T, 4), rounded to counts, against actions (T, 4)."""
    rounded = np.round(sent / COUNT) * COUNT
    columns = {"episode": np.zeros(ROWS), "time": np.arange(ROWS) / 50.0, "flag.limited": limited}
    columns |= {f"action.{i}": action[:, i] for i in range(4)}
    columns |= {f"qpos.{name}": rounded[:, i] for i, name in enumerate(JOINTS)}
    columns |= {f"ctrl.{name}": rounded[:, i] for i, name in enumerate(JOINTS)}
    rows = Rows.of([Log(columns, {})])
    stage = Stage()
    check_action(stage, rows, described(path / "OBS.yaml"), DEFAULT.contract)
    return stage


def test_a_wrong_scale_far_from_the_pose_is_no_offset(tmp_path):
    """Actions of 1.5 and more that move by a few counts: their spread does not tell the factor."""
    rng = np.random.default_rng(4)
    action = np.array([1.5, -2.0, 2.5, -1.2]) + 0.01 * rng.standard_normal((ROWS, 4))
    found = commands(tmp_path, action, POSE + 0.7 * SCALE * action, np.zeros(ROWS)).findings
    assert [(one.fault, one.where) for one in found] == [("scale", "ctrl")]
    assert found[0].value is not None
    assert abs(found[0].value - 0.7) < 1e-3


def test_a_command_that_rests_is_off_by_its_rounding_alone(tmp_path):
    """Half a count is no offset, also where the guard cut the first row."""
    action = np.tile([2.7, -2.7, 2.71, -2.71], (ROWS, 1))
    sent, limited = POSE + SCALE * action, np.zeros(ROWS)
    sent[0] -= 0.1
    limited[0] = 1.0
    off = np.abs(np.round(sent[1] / COUNT) - sent[1] / COUNT)
    assert off.max() > 0.3  # counts: more than rounding makes on average
    assert commands(tmp_path, action, sent, limited).findings == []


def test_a_late_command_is_told_from_the_few_that_the_guard_let_pass(tmp_path):
    """The guard cuts a joint or more in nearly every row; where one went less far, it was free."""
    rng = np.random.default_rng(6)
    action = 2.0 * rng.standard_normal((ROWS, 4))
    wanted = POSE + SCALE * np.clip(action, -3.0, 3.0)
    late, sent, cut = older(wanted, 2), [POSE], []
    for goal in late:
        sent.append(sent[-1] + np.clip(goal - sent[-1], -0.15, 0.15))
        cut.append(float(np.any(sent[-1] != goal)))
    assert np.mean(cut) > 0.97
    made = commands(tmp_path, action, np.array(sent[1:]), np.array(cut))
    assert [(one.fault, one.where, one.value) for one in made.findings] == [("age", "ctrl", 2.0)]


def test_what_the_guard_cut_all_the_time_is_said_and_not_guessed(tmp_path):
    """Nothing passed: commands that follow no law are no finding."""
    rng = np.random.default_rng(7)
    action = 2.0 * rng.standard_normal((ROWS, 4))
    made = commands(tmp_path, action, POSE + 0.1 * rng.standard_normal((ROWS, 4)), np.ones(ROWS))
    assert made.findings == []
    assert any("the guard cut 300 of 300 rows" in one.text for one in made.cannot_tell)


@pytest.mark.parametrize(("seconds", "told"), [(2, True), (200, False)])
def test_a_number_that_hardly_changes_in_a_step_has_no_age(seconds, told):
    """A ramp of 200 s is the same a step later, as far as misfits differ."""
    count = 50 * seconds
    ramp = np.linspace(0.0, 1.0, count)[:, None]
    columns = {"episode": np.zeros(count), "time": np.arange(count) / 50.0}
    rows = Rows.of([Log({**columns, "qpos.x": ramp[:, 0], "ctrl.x": ramp[:, 0]}, {})])
    target = Target("observation", "channel", ["x"], ramp, np.ones(1), False)
    stage = decode(target, [Variant(None, ramp, np.zeros(1))], rows, DEFAULT.contract)
    assert stage.findings == []
    assert [one.where for one in stage.cannot_tell] == ["channel"] * (not told)
