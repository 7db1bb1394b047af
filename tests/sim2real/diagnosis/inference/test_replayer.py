"""The windows that a judge looks at."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.candidates import candidates
from sim2real.diagnosis.inference.episodes import cut_whole_episodes
from sim2real.diagnosis.inference.hypotheses import Hypothesis, Member
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.replayer import Job, Replayer
from sim2real.diagnosis.inference.run import skip_ends
from sim2real.loops.improve.target import cut
from tests.sim2real.diagnosis import arm

ROWS = 6


def test_ends_of_episodes_are_left_out(tmp_path: Path) -> None:
    """What was logged at another time is unknown there; servos first correct a start in motion."""
    data = arm.data_of(arm.make_log(), tmp_path)
    later, log, last = skip_ends(data), data.logs[0], len(data.windows) - 1
    assert [w.start for w in later.windows] == [max(w.start, ROWS) for w in data.windows]
    first = later.windows[0]
    np.testing.assert_array_equal(
        first.recording.qpos, [log.columns[f"qpos.{n}"][ROWS] for n in arm.JOINTS]
    )
    begin = log.time[ROWS] + data.settings.windows.warm_s
    own = np.arange(first.first, first.first + len(first.usable))
    np.testing.assert_array_equal(later.mask[0, : len(own)], log.time[own] >= begin)
    shown = data.mask[last].sum() - ROWS
    assert later.mask[last, :shown].all() and not later.mask[last, shown:].any()
    np.testing.assert_array_equal(later.mask[1:last], data.mask[1:last])
    assert later.windows[1] is data.windows[1]


@pytest.mark.parametrize("seconds", [0.1, 0.2])
def test_an_episode_that_is_all_ends_is_left_whole(seconds: float, tmp_path: Path) -> None:
    """Nothing would be left of it, and its windows still start where they are compared."""
    data = arm.data_of(cut(arm.make_log(noise=1e-4), seconds), tmp_path)
    assert all(len(part) <= 2 * ROWS for part in data.logs[0].episodes())
    later = skip_ends(data)
    np.testing.assert_array_equal(later.mask, data.mask)
    assert all(a is b for a, b in zip(later.windows, data.windows, strict=True))


def test_an_episode_is_one_window(tmp_path: Path) -> None:
    """From where its first window starts to its last row."""
    data = arm.data_of(arm.make_log(), tmp_path)
    (whole,) = cut_whole_episodes(data)
    assert (whole.first, whole.last) == (0, len(data.logs[0]))
    (later,) = cut_whole_episodes(skip_ends(data))
    assert (later.start, later.first) == (ROWS, ROWS)


def test_a_logged_speed_is_as_unsure_as_it_scatters(tmp_path: Path) -> None:
    """Windows start at it; one of a smooth register is surer than that of a noisy one."""
    log, rng = arm.make_log(noise=1e-4), np.random.default_rng(0)
    slopes = {f"qvel.{n}": np.gradient(log.columns[f"qpos.{n}"], log.time) for n in arm.JOINTS}
    unsure = []
    for noise in (0.0, 0.2):  # rad/s
        read = {name: speed + noise * rng.normal(size=len(log)) for name, speed in slopes.items()}
        data = arm.data_of(Log({**log.columns, **read}), tmp_path)
        unsure.append(Replayer(data).speed_noise * data.scale)
    smooth, noisy = unsure
    assert (noisy >= smooth).all()
    assert np.median(noisy) == pytest.approx(0.2, rel=0.3)


def test_noise_that_is_known_beforehand_is_the_least(tmp_path: Path) -> None:
    """An axis that hardly moves looks better than its instrument is."""
    data = arm.data_of(arm.make_log(noise=1e-4), tmp_path)
    free, known = Replayer(data).noise * data.scale, (0.01, 0.0)
    joints = [joint._replace(floor=own) for joint, own in zip(data.joints, known, strict=True)]
    least = Replayer(replace(data, joints=tuple(joints))).noise * data.scale
    np.testing.assert_allclose(least, np.maximum(free, known))
    assert free[0] < known[0]


def test_late_readings_beside_friction_are_undone_in_the_log(tmp_path: Path) -> None:
    """Whatever the order in which members are named, each gets its own values."""
    data = arm.data_of(arm.make_log(("coulomb_friction", {"where": "b"}, 0.12)), tmp_path)
    late = next(c for c in list_log_changes(data) if c.label == "observation_delay")
    friction = next(c for c in candidates(data) if c.label == "coulomb_friction.b")
    replayer = Replayer(data)

    def errors(members: list[Member], values: list[float]) -> np.ndarray:
        rows = np.tile(values, (len(replayer.every), 1))
        return replayer.follow(Hypothesis.of(members), rows)[0]

    alone = errors([friction], [0.12])
    for members in ([late, friction], [friction, late]):
        np.testing.assert_allclose(errors(members, [0.12, 0.0]), alone, atol=1e-6)
        assert np.abs(errors(members, [0.12, 0.02]) - alone).max() > 1e-3


def test_late_commands_are_early_readings(tmp_path: Path) -> None:
    """The two say the same of a log, and so do their errors: they are of the same readings."""
    data = skip_ends(arm.data_of(arm.make_log(noise=1e-3), tmp_path))
    changes = {change.label: change for change in list_log_changes(data)}
    replayer, errors = Replayer(data), []
    for column, rows in (("ctrl", 2.0), ("qpos", -2.0)):
        shift = Hypothesis((changes[f"log.row_shift.{column}"],))
        values = np.full((len(replayer.every), 1), rows)
        errors.append(replayer.replay([Job(shift, values, replayer.every)])[0].error)
    np.testing.assert_allclose(errors[1], errors[0], atol=1e-4)
    (given,) = replayer.replay([Job(Hypothesis(()), np.zeros((len(values), 0)), replayer.every)])
    assert np.abs(errors[0] - given.error).max() > 0.1


def test_errors_are_those_of_readings_as_logged(tmp_path: Path) -> None:
    """Degrees for radians: what is left of them is in degrees, and so is the start's noise."""
    log, factor = arm.make_log(noise=1e-3), 180 / np.pi
    logged = {n: c * (factor if n.startswith("q") else 1) for n, c in log.columns.items()}
    right, wrong = (Replayer(arm.data_of(one, tmp_path)) for one in (log, Log(logged)))
    changes = {change.label: change for change in list_log_changes(wrong.data)}
    unit = Hypothesis((changes["log.unit.qpos"],))
    wrong.rows, wrong.used = right.rows, right.used
    none = np.zeros((len(right.every), 0))
    for made, mended in (
        (
            right.replay([Job(Hypothesis(()), none, right.every)])[0].error,
            wrong.replay([Job(unit, none, wrong.every)])[0].error,
        ),
        (right.follow(Hypothesis(()), none)[0], wrong.follow(unit, none)[0]),
        (right.starts(Hypothesis(()), none), wrong.starts(unit, none)),
    ):
        scale = wrong.data.scale / right.data.scale
        scale = scale[:, None] if made.ndim > 3 else scale
        np.testing.assert_allclose(mended * scale, factor * made, rtol=0.1, atol=1e-6)
