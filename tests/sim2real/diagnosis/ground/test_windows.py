"""Short windows from estimated starts: the right model follows, a wrong start is no error."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.ground.logs import estimate_all
from sim2real.diagnosis.ground.pushes import check_pushes
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.locate import as_gaps
from sim2real.diagnosis.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis.ground.walk import trot, without

Cut = tuple[Data, Data, list[Estimate]]


@pytest.fixture(scope="module")
def cut() -> Cut:
    """Return the data of a short trot as it is cut today and from estimates, and these."""
    log = without(trot(seconds=1.5).log, "accelerometer")
    estimates = estimate_all([log], None, DEFAULT.ground)
    data = Data.of([one.log for one in estimates])
    return data, grounded(data, estimates), estimates


def errors(data: Data) -> np.ndarray:
    """Return each position's root mean square error with the model as given [rad], (M,)."""
    every = np.arange(len(data.windows))
    simulated = Simulator(data).run((), every, np.zeros((len(every), 0)))
    return np.sqrt(data.mean_squares(simulated.error))


def test_windows_are_short_and_compare_joints_and_the_turn(cut: Cut) -> None:
    """A third of a second; eight joints and three numbers of a quaternion."""
    _, data, _ = cut
    lengths = [w.sample[-1, 0] - w.sample[0, 0] for w in data.windows]
    assert 0.2 < np.median(lengths) < 0.35
    assert [joint.name for joint in data.joints][8:] == ["root.4", "root.5", "root.6"]
    assert data.measured.shape[2] == 11
    assert all(abs(w.recording.qpos[6]) < 0.2 for w in data.windows)  # no heading


def test_the_robots_own_model_follows_to_an_encoder_count(cut: Cut) -> None:
    """Where the base's start is only estimated."""
    _, data, _ = cut
    assert errors(data).max() < 2 * np.pi / 4096


def test_a_start_that_is_off_is_no_error(cut: Cut) -> None:
    """Every window begins 0.1 m/s too fast: seen without the nuisance, not with it."""
    _, data, _ = cut
    wrong = []
    for window in data.windows:
        qvel = window.recording.qvel.copy()
        qvel[:2] += 0.1
        wrong.append(window._replace(recording=window.recording._replace(qvel=qvel)))
    off = replace(data.with_windows(wrong), nuisance=data.nuisance)
    plain, cleared = errors(replace(off, nuisance=None)), errors(off)
    assert np.linalg.norm(plain) > 2 * np.linalg.norm(cleared)


def test_a_log_that_holds_its_base_is_cut_as_before(cut: Cut) -> None:
    """No estimate is made of it, and mixed logs are refused."""
    _, _, estimates = cut
    assert estimate_all([estimates[0].log], None, DEFAULT.ground) == []
    log = without(estimates[0].log, "accelerometer")
    bare = {n: c for n, c in log.columns.items() if ".root." not in n}
    with pytest.raises(Sim2RealError, match="diagnose them separately"):
        estimate_all([log, replace(log, columns=bare)], None, DEFAULT.ground)


def pushed(size: float) -> tuple[Data, list[Estimate]]:
    """Return the windows of a trot that is pushed at 2 s, and what they start from."""
    log = without(trot(seconds=4.0, push=size).log, "accelerometer")
    estimates = estimate_all([log], None, DEFAULT.ground)
    return grounded(Data.of([one.log for one in estimates]), estimates), estimates


def test_a_push_is_told_and_left_out(cut: Cut) -> None:
    """Windows around it, and no others; without one none goes."""
    _, data, estimates = cut
    assert check_pushes(data, estimates, DEFAULT.ground) == []
    (finding,) = check_pushes(*pushed(1.0), DEFAULT.ground)
    moments = [float(part) for part in re.findall(r"\d\.\d\d", finding.finding)]
    assert 0 < len(moments) < 3
    assert all(1.6 < moment < 2.1 for moment in moments)


@pytest.mark.slow
def test_a_light_push_makes_its_window_count_for_less() -> None:
    """No window goes; those about the push weigh less, and the report tells when."""
    data, estimates = pushed(0.3)
    assert data.nuisance is not None
    light = [w for w, k in zip(data.windows, data.nuisance.weight, strict=True) if k < 1]
    assert 0 < len(light) < 3
    assert all(1.6 < estimates[0].log.time[w.start] < 2.1 for w in light)
    (finding,) = check_pushes(data, estimates, DEFAULT.ground)
    assert finding.check == "odd"


def test_a_window_that_counts_for_less_has_smaller_errors(cut: Cut) -> None:
    """By its weight, whatever is simulated; the others stay."""
    _, data, _ = cut
    assert data.nuisance is not None
    weight = np.ones(len(data.windows))
    weight[1] = 0.5
    every, rng = np.arange(len(weight)), np.random.default_rng(0)
    error = rng.normal(size=(len(weight), *data.measured.shape[1:]))
    plain = data.nuisance.clear(every, error)
    less = data.nuisance.weighed(weight).clear(every, error)
    np.testing.assert_allclose(less, weight[:, None, None] * plain)


def test_the_gap_of_a_turn_lies_where_its_windows_say(cut: Cut) -> None:
    """Measured and simulated turns have one heading: their difference is the error."""
    _, data, _ = cut
    every = np.arange(len(data.windows))
    error = Simulator(data).run((), every, np.zeros((len(every), 0))).error
    (gap,) = as_gaps(data, error)
    off = np.sqrt(np.mean((gap.simulated - gap.measured) ** 2, axis=0))
    assert np.allclose(off, data.scale * np.sqrt(data.mean_squares(error)))
