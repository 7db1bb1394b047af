"""Short windows from estimated starts: the right model follows, a wrong start is no error."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.diagnose import diagnose
from sim2real.diagnosis.ground.estimate import Estimate, estimate_all
from sim2real.diagnosis.ground.pushes import check_pushes
from sim2real.diagnosis.ground.starts import clear_starts
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.inference.replayer import Replayer
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
    """Every window begins 0.1 m/s too fast: seen, and put down to the starts."""
    _, data, _ = cut
    wrong = []
    for window in data.windows:
        qvel = window.recording.qvel.copy()
        qvel[:2] += 0.1
        wrong.append(window._replace(recording=window.recording._replace(qvel=qvel)))
    assert data.starts is not None
    every = np.arange(len(wrong))
    plain = Simulator(data.with_windows(wrong)).run((), every, np.zeros((len(every), 0))).error
    cleared = clear_starts(plain, data.starts, DEFAULT.ground.error_rad)
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
    assert list(check_pushes(data, estimates)) == []
    (finding,) = check_pushes(*pushed(1.0))
    moments = [float(part) for part in re.findall(r"\d\.\d\d", finding.finding)]
    assert 0 < len(moments) < 3
    assert all(1.6 < moment < 2.1 for moment in moments)


def test_the_gap_of_a_turn_lies_where_its_windows_say(cut: Cut) -> None:
    """Measured and simulated turns have one heading: their difference is the error."""
    _, data, _ = cut
    every = np.arange(len(data.windows))
    error = Simulator(data).run((), every, np.zeros((len(every), 0))).error
    (gap,) = as_gaps(data, error)
    off = np.sqrt(np.mean((gap.simulated - gap.measured) ** 2, axis=0))
    assert np.allclose(off, data.scale * np.sqrt(data.mean_squares(error)))


def test_a_turn_stays_where_joints_keep_their_speed(cut: Cut) -> None:
    """A quaternion's parts have no speed of their own; joints move on."""
    _, data, _ = cut
    replayer = Replayer(data)
    stays, moves = replayer.holding(), replayer.coasting()
    assert np.array_equal(stays[..., 8:], moves[..., 8:])
    assert not np.allclose(stays[..., :8], moves[..., :8])


@pytest.mark.slow
def test_a_walk_of_the_model_itself_has_no_gap() -> None:
    """From estimated starts to the verdict."""
    report = diagnose(without(trot().log, "accelerometer"))
    assert report.verdict == "no_gap"
    assert "base" in {finding.check for finding in report.preflight}
