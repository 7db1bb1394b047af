"""A recording on the clock of a simulation."""

import numpy as np
import pytest

from envs.errors import TaskError
from envs.replay import Recording, groups, schedule

DT = 0.01


def test_a_command_holds_from_the_first_step_not_before_it() -> None:
    """One written at 12 ms acts from the step at 20 ms on; one at 30 ms acts there."""
    time = np.array([0.0, 0.012, 0.03 + 1e-12])
    ctrl = np.array([[1.0], [2.0], [3.0]])
    plan = schedule(Recording(time, ctrl, np.zeros(1), np.zeros(1)), DT)
    assert plan.ctrl[:, 0].tolist() == [1.0, 1.0, 2.0, 3.0]
    assert plan.held == 1.0


def test_a_servo_is_off_with_its_rows_command() -> None:
    """The bit of each actuator follows the row whose command is in force."""
    powered = np.array([[True, True], [False, True], [True, False]])
    times, zeros = np.array([0.0, 0.015, 0.03]), np.zeros((3, 2))
    plan = schedule(Recording(times, zeros, np.zeros(2), np.zeros(2), powered), DT)
    assert plan.off.tolist() == [0b00, 0b00, 0b01, 0b10]


def test_readings_after_the_last_command_are_reached() -> None:
    """The schedule goes one step beyond the last moment, so that it can be interpolated."""
    recording = Recording(np.array([0.0, 0.02]), np.ones((2, 1)), np.zeros(1), np.zeros(1))
    assert schedule(recording, DT).steps == 3
    late = schedule(recording._replace(read=np.array([[0.0], [0.051]])), DT)
    assert late.steps == 7
    assert late.ctrl.tolist() == [[1.0]] * 7


def test_actuators_that_share_a_group_are_switched_together() -> None:
    """A humanoid has more of them than the engine has groups."""
    times, zeros = np.array([0.0, 0.01, 0.02]), np.zeros((3, 40))
    powered = np.ones((3, 40), bool)
    powered[1, 30:], powered[2, 3] = False, False
    recording = Recording(times, zeros, np.zeros(40), np.zeros(40), powered)
    assert schedule(recording, DT).off.tolist() == [0, 1 << 30, 1 << 3]
    assert groups(40).tolist() == [*range(31), *[30] * 9]
    powered[1, 35] = True
    with pytest.raises(TaskError, match=r"actuator 36 of 40 is switched off at other moments than"):
        schedule(recording, DT)
