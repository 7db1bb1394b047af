"""What a fit knows on its way."""

from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Trained
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.replayer import Replay
from sim2real.diagnosis.inference.state import State
from sim2real.diagnosis.inference.vocabulary import list_effects
from tests.sim2real.diagnosis import arm

NONE = np.zeros((2, 1, 1))


def make_state(hypothesis: Hypothesis, values: list[list[float]], density: list[float]) -> State:
    """Return values (2, P) under which each fold has a log density [nats]."""
    index = np.zeros(1, int)
    trained = [Trained(index, index, index, np.zeros(0), np.zeros((0, 0)), d) for d in density]
    return State(hypothesis, np.array(values), Replay(NONE, NONE), trained)


@pytest.fixture
def rubbing(tmp_path: Path) -> Hypothesis:
    """Return dry friction at both joints of the arm."""
    effects = list_effects(arm.data_of(arm.make_log(noise=3e-4), tmp_path))
    own = {member.label: member for member in effects}
    return Hypothesis(tuple(own[f"coulomb_friction.{name}"] for name in arm.JOINTS))


def test_no_slope_is_taken_across_where_readings_change_rows(tmp_path: Path) -> None:
    """Half a row old, they go to the row before, and windows start elsewhere: errors jump."""
    data = arm.data_of(arm.make_log(noise=3e-4), tmp_path)  # 20 ms a row
    (late,) = [change for change in list_log_changes(data) if change.effect is not None]
    below, far = [[0.00999], [0.004]]
    nudges = make_state(Hypothesis((late,)), [below, far], [0.0, 0.0]).nudges(0.03, 0.01)
    np.testing.assert_allclose(nudges, [[-6e-4], [6e-4]])


def test_the_best_change_of_each_value_is_joined_in_each_fold(rubbing: Hypothesis) -> None:
    """What loses stays as it is."""
    state = make_state(rubbing, [[0.1, 0.2]] * 2, [10.0, 10.0])
    others = [
        make_state(rubbing, [[0.12, 0.2]] * 2, [11.0, 12.0]),
        make_state(rubbing, [[0.15, 0.2]] * 2, [13.0, 9.0]),
        make_state(rubbing, [[0.1, 0.3]] * 2, [14.0, 9.0]),
    ]
    joined = state.join(others)
    assert joined is not None
    np.testing.assert_allclose(joined, [[0.15, 0.3], [0.12, 0.2]])


def test_one_change_that_gains_is_a_trial_of_its_own(rubbing: Hypothesis) -> None:
    """It was replayed already."""
    state = make_state(rubbing, [[0.1, 0.2]] * 2, [10.0, 10.0])
    better = make_state(rubbing, [[0.12, 0.2]] * 2, [11.0, 12.0])
    worse = make_state(rubbing, [[0.1, 0.3]] * 2, [9.0, 10.0])
    assert state.join([better, worse]) is None
    assert state.join([]) is None
