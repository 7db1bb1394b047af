"""Situations that people report: what is asked of the diagnosis."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.log import read_log
from sim2real.diagnosis.diagnose import diagnose
from sim2real.exam.measure import apart
from tests.sim2real.diagnosis.strangers.situations import SITUATIONS, nothing


def test_a_servo_that_hides_nothing_follows_its_model(tmp_path: Path) -> None:
    """The control: the independent law and the nominal model agree to a few counts."""
    made = nothing(tmp_path)
    spec = mujoco.MjSpec.from_file(str(made.model))
    assert apart(read_log(made.log), spec).max() < 0.004


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_nothing_hidden_is_no_gap(tmp_path: Path) -> None:
    """The control of all situations."""
    made = nothing(tmp_path)
    assert diagnose(made.log, made.model).verdict == "no_gap"


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", SITUATIONS)
def test_a_situation_is_named_for_what_it_is(name: str, tmp_path: Path) -> None:
    """The first cause is of the right kind, at its place, of its size; nothing else is named."""
    situation = SITUATIONS[name]
    made = situation.make(tmp_path)
    report = diagnose(made.log, made.model)
    assert np.isfinite(report.gap.before)
    assert situation.expected.miss(report) is None
