"""Logs cut into windows, and simulations of them."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm

OFFSET = ("coulomb_friction", {"where": "a"}, 0.1)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Data:
    """A log of the arm, whose first joint rubs."""
    return arm.data_of(arm.make_log(OFFSET), tmp_path_factory.mktemp("arm"))


def test_windows_cover_the_log_once(data: Data) -> None:
    """Every row is compared in exactly one window."""
    rows = np.concatenate([np.arange(w.first, w.last) for w in data.windows])
    assert sorted(rows) == list(range(len(data.logs[0])))
    assert data.mask.sum() == len(data.logs[0])


def test_the_last_bit_of_a_time_moves_no_window(data: Data, tmp_path: Path) -> None:
    """Times in milliseconds, or in nanoseconds from 1970, differ in their last bit: no row more."""
    (log,) = data.logs
    for direction in (-np.inf, np.inf):
        for chosen in (slice(None), slice(None, None, 2), slice(1, None, 2)):
            time = log.time.copy()
            time[chosen] = np.nextafter(time[chosen], direction)
            again = arm.data_of(Log(dict(log.columns) | {"time": time - time[0]}), tmp_path)
            for one, other in zip(data.windows, again.windows, strict=True):
                assert one[:6] == other[:6]


def test_the_true_model_has_no_error(data: Data) -> None:
    """Windows started from measured states follow the log once the hidden effect is in."""
    every = np.arange(len(data.windows))
    simulator = Simulator(data, threads=1)
    wrong = simulator.run((), every, np.zeros((len(every), 0)))
    effect = (make("coulomb_friction", where="a"),)
    right = simulator.run(effect, every, np.full((len(every), 1), 0.1))
    assert np.sqrt(np.mean(right.error**2)) < 0.1 * np.sqrt(np.mean(wrong.error**2))
    assert np.isinf(right.lost).all()


def test_a_model_that_breaks_is_lost_and_bounded(data: Data) -> None:
    """A diverged row says when, and its error stays finite."""
    every = np.arange(len(data.windows))
    effect = (make("motor_strength", where="a"),)
    broken = Simulator(data, threads=1).run(effect, every, np.full((len(every), 1), 1e9))
    assert np.isfinite(broken.lost).any()
    assert np.isfinite(broken.error).all()


def test_rows_that_tell_nothing_are_left_out(tmp_path: Path) -> None:
    """A reading that was missing, and the moments after torque came back, are not compared."""
    log = arm.make_log()
    torque, fresh = np.ones(len(log)), np.ones(len(log))
    torque[100:150], fresh[300] = 0.0, 0.0
    columns = {**log.columns, "torque.a": torque, "flag.fresh": fresh}
    data = arm.data_of(Log(columns), tmp_path)
    left_out = len(log) - int(data.mask.sum())
    assert 0.3 * 50 <= left_out <= 0.3 * 50 + 5


def test_joints_that_never_moved_are_named(tmp_path: Path) -> None:
    """A log without excitation says which joints, and what to record."""
    log = arm.make_log(seconds=4.0)
    columns = {
        name: np.zeros(len(log)) if name.startswith("qpos") else values
        for name, values in log.columns.items()
    }
    with pytest.raises(Sim2RealError, match=r"a, b never moved .*run=record"):
        arm.data_of(Log(columns), tmp_path)


@pytest.mark.parametrize(
    ("rows", "factor", "message"),
    [
        (10, 1.0, r"0.18 s of recordings are too short .* record a minute"),
        (None, 1e3, "multiply it by 0.001"),
        (None, 1e-3, "multiply it by 1000"),
    ],
)
def test_a_log_that_can_show_nothing_is_refused(
    tmp_path: Path, rows: int | None, factor: float, message: str
) -> None:
    """Ten rows have no interval; rows 20 s or 20 µs apart are no seconds: none is explained."""
    log = arm.make_log(seconds=4.0)
    columns = {name: values[:rows] for name, values in log.columns.items()}
    columns["time"] = factor * columns["time"]
    with pytest.raises(Sim2RealError, match=message):
        arm.data_of(Log(columns), tmp_path)


def test_a_log_that_is_blocked_throughout_is_refused(tmp_path: Path) -> None:
    """It would be left without a window; the message says which and what to do."""
    log = arm.make_log(seconds=4.0)
    blocked = Log({**log.columns, "flag.blocked": np.ones(len(log))}, log.meta, Path("b.csv"))
    with pytest.raises(Sim2RealError, match=r"b.csv: no piece of its 200 rows .* remove it"):
        Data.of([log, blocked], arm.model(tmp_path))
