"""A quicker look: in longer time steps, less what these change of the model as given."""

import math
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.inference.candidates import candidates
from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.glance import LEAST
from sim2real.diagnosis.inference.hypotheses import NONE, Hypothesis
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.moves import restart
from sim2real.diagnosis.inference.replayer import Job
from sim2real.diagnosis.inference.score import FOLDS
from tests.sim2real.diagnosis import arm


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Judge:
    """Return the judge of an arm whose second joint rubs."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=3e-4)
    folder: Path = tmp_path_factory.mktemp("arm")
    return Judge(arm.data_of(log, folder))


def test_the_model_as_given_is_as_it_is_in_its_own_steps(judge: Judge) -> None:
    """In every window of the glance."""
    glance = judge.search.glance.replayer
    (seen,) = glance.replay([Job(NONE, np.zeros((len(glance.every), 0)), glance.every)])
    starts = [(window.log, window.start) for window in judge.data.windows]
    chosen = [starts.index((window.log, window.start)) for window in glance.data.windows]
    np.testing.assert_allclose(seen.error, judge.given.own[chosen], atol=1e-12)
    assert glance.data.models[0].opt.timestep > judge.data.models[0].opt.timestep


def test_springs_and_play_take_shorter_steps_than_the_rest(judge: Judge) -> None:
    """Their swing is faster than the robot's: what they change is that of the finer model."""
    glance, options = judge.search.glance.replayer, {c.label: c for c in candidates(judge.data)}
    assert glance.finer is not None
    times = [one.data.models[0].opt.timestep for one in (glance, glance.finer)]
    assert times[1] <= times[0] / 2
    spring = next(one for label, one in options.items() if label.startswith("joint_compliance.b"))
    jobs = [
        Job(Hypothesis((one,)), np.tile(one.probes[0], (len(glance.every), 1)), glance.every)
        for one in (spring, options["coulomb_friction.b"])
    ]
    both = glance.replay(jobs)
    (fine,) = glance.finer.replay(jobs[:1])
    np.testing.assert_array_equal(both[0].error, fine.error)
    (other,) = glance.finer.replay(jobs[1:])
    assert np.abs(other.error - both[1].error).max() > 0


def test_what_longer_steps_change_is_what_they_change_of_what_is_known(judge: Judge) -> None:
    """With friction as it is in its own steps, a spring is compared with that."""
    glance, options = judge.search.glance, {c.label: c for c in candidates(judge.data)}
    friction = options["coulomb_friction.b"]
    (best,) = judge.fitter.fit([Start(Hypothesis((friction,)), np.array([[0.12]]))], rounds=0)
    (before,) = glance.fit([restart(best)], rounds=0)
    glance.anchor(best)
    (base,) = glance.fit([restart(best)], rounds=0)
    np.testing.assert_allclose(base.own, best.own[glance.chosen], atol=1e-12)
    assert np.abs(before.own - base.own).max() > 1e-5
    assert glance.replayer.finer is not None
    job = Job(best.hypothesis, best.values[glance.fold], glance.replayer.every)
    (fine,) = glance.replayer.finer.replay([job])
    np.testing.assert_allclose(fine.error, base.own, atol=1e-12)
    glance.anchor(judge.given)


def test_what_is_fitted_in_longer_steps_is_of_all_windows(judge: Judge) -> None:
    """The model as given scores as it does in its own steps, and friction comes out as large."""
    quick, label = judge.search.quick, "coulomb_friction.b"
    (given,) = quick.fit([restart(judge.given)], rounds=0)
    np.testing.assert_allclose(given.score, judge.given.score, atol=1e-9)
    (member,) = [one for one in candidates(judge.data) if one.label == label]
    start = Start(Hypothesis((member,)), np.array([[0.1]]))
    coarse, own = (fitter.fit([start])[0] for fitter in (quick, judge.fitter))
    np.testing.assert_allclose(coarse.values, own.values, rtol=0.02)
    assert coarse.total == pytest.approx(own.total, rel=0.02)


def test_a_part_of_long_logs_is_looked_at(tmp_path: Path) -> None:
    """Of each fold as many windows, over the whole log, as the setting says; at most half."""
    judge = Judge(arm.data_of(arm.make_log(seconds=60.0, noise=3e-4), tmp_path))
    glance, times = judge.search.glance, judge.replayer.times
    length = float(np.mean(np.ptp(times, axis=1)))
    wanted = max(LEAST, math.ceil(judge.settings.glance_s / FOLDS / length))
    assert np.bincount(glance.fold).tolist() == [wanted] * FOLDS
    assert len(times) > 2 * FOLDS * wanted  # or half of them would be the limit
    left = judge.left_in_windows(judge.given)
    for own in judge.fitter.sides:
        most = own[np.argsort(-left[own])[: wanted // 2]]
        rest = np.setdiff1d(np.intersect1d(own, glance.chosen), most)
        assert set(most) <= set(glance.chosen)
        others = np.setdiff1d(own, most)
        assert {others[0], others[-1]} <= set(rest)  # from the first to the last of the log
