"""Windows of joints that motors drive: a rough start is not blamed on the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.starts import with_free_starts
from tests.sim2real.diagnosis import arm, motors

COUNT = 2 * np.pi / 4096  # rad
SECONDS = 8.0


def data_of(folder: Path, friction: float, speeds: bool = False) -> Data:
    """Return windows of the arm of motors, read in counts; `speeds` logs those of its joints."""
    log = motors.make_log(friction, SECONDS)
    columns = dict(log.columns)
    for name in "ab":
        angle = columns[f"qpos.{name}"]
        columns[f"qpos.{name}"] = np.round(angle / COUNT) * COUNT
        columns |= {f"qvel.{name}": np.gradient(angle, log.time)} if speeds else {}
    return Data.of([Log(columns)], motors.model(folder))


def rms(data: Data) -> float:
    """Return the error of all windows with the model as given [rad]."""
    every = np.arange(len(data.windows))
    error = Simulator(data).run((), every, np.zeros((len(every), 0))).error * data.scale
    return float(np.sqrt((error[data.mask] ** 2).mean()))


def test_what_counts_make_of_a_start_is_no_gap(tmp_path: Path) -> None:
    """The model is right: without its starts' errors it follows to less than half a count."""
    plain = data_of(tmp_path, 0.0)
    free = with_free_starts(plain)
    assert rms(plain) > 1.5 * COUNT
    assert rms(free) < 0.5 * COUNT
    assert free.measured is plain.measured  # the windows are the same


def test_what_no_start_makes_stays(tmp_path: Path) -> None:
    """A joint that rubs is far from its model however its windows start."""
    right, rubs = (with_free_starts(data_of(tmp_path, friction)) for friction in (0.0, 0.1))
    assert rms(rubs) > 10 * rms(right)


def test_a_joint_that_never_moves_is_no_trouble(tmp_path: Path) -> None:
    """Its readings have no noise at all: the others are cleared as ever."""
    log, spec = motors.make_log(0.0, SECONDS), motors.spec()
    body = spec.worldbody.add_body(pos=[2, 0, 0])
    body.add_joint(name="still", damping=1.0)
    body.add_geom(size=[0.1, 0, 0])
    path = tmp_path / "still.xml"
    spec.compile()
    path.write_text(spec.to_xml(), encoding="utf-8")
    columns = {n: np.round(c / COUNT) * COUNT if "qpos" in n else c for n, c in log.columns.items()}
    data = with_free_starts(Data.of([Log(columns | {"qpos.still": 0 * log.time})], path))
    assert [joint.name for joint in data.joints] == ["a", "b", "still"]
    assert rms(data) < 0.5 * COUNT


def test_errors_like_those_of_starts_become_noise(tmp_path: Path) -> None:
    """Errors of noise and of starts that are as far off as is likely have the noise's size."""
    data = with_free_starts(data_of(tmp_path, 0.0))
    nuisance, rows = data.nuisance, 4000
    assert nuisance is not None
    rng, window, shape = np.random.default_rng(0), 3, (rows, *data.measured.shape[1:])
    size = np.sqrt(1 / (1 - nuisance.gone[window]) ** 2 - 1)  # of a start's error, over the noise
    starts = (rng.standard_normal((rows, len(size))) * size) @ nuisance.ways[window].T
    error = (starts.reshape(shape) + rng.standard_normal(shape)) * nuisance.noise
    cleared = nuisance.clear(np.full(rows, window), error) / nuisance.noise
    along = cleared.reshape(rows, -1) @ nuisance.ways[window]
    assert along.std(axis=0) == pytest.approx(np.ones(len(size)), abs=0.05)


def test_known_starts_and_servos_stay_as_they_are(tmp_path: Path) -> None:
    """Logged speeds say how a window starts, and a servo pulls back what is wrong with it."""
    assert with_free_starts(data_of(tmp_path, 0.0, speeds=True)).nuisance is None
    assert with_free_starts(arm.data_of(arm.make_log(seconds=6.0), tmp_path)).nuisance is None
