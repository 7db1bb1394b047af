"""The policy in both simulators, with a made-up robot whose distributions are known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.closed_loop.check import Drawn, check_closed_loop, closed_loop_of
from sim2real.diagnosis.closed_loop.measured import Episode, episodes_of, histories, shared
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import DEFAULT, ClosedLoopSettings
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis.report import sample

FEW = replace(
    DEFAULT,
    closed_loop=ClosedLoopSettings(episodes=8, samples=20),
    bootstrap=replace(DEFAULT.bootstrap, draws=40),
)
RATE, ROWS = 50.0, 60
STEP = 1 / RATE
WEAK = [Drawn(make("motor_strength", where="hinge"), (0.5,), (0.45, 0.55))]


def motion(size: float, rng: np.random.Generator) -> np.ndarray:
    """Return an oscillation of that size whose phase is drawn: nothing could align two of them."""
    time = np.arange(ROWS) * STEP + rng.uniform(0, 2)
    return size * np.sin(2 * np.pi * time) + 0.02 * rng.normal(size=ROWS)


class Swing:
    """A policy whose joint swings as far as the motor is strong; it earns that much."""

    name, step, needs_tracker = "swing", STEP, True

    def __init__(self, nominal: float = 1.0) -> None:
        self.nominal, self.given = nominal, []

    def __call__(self, effects: Sequence[Drawn], episodes: int, seed: int) -> list[Episode]:
        """Play with strengths that are drawn from their interval."""
        rng = np.random.default_rng([seed, 1 + len(effects)])
        self.given.append(list(effects))
        found = []
        for _ in range(episodes):
            size = self.nominal
            for _, (value, *_), ci in effects:
                size *= value + (0.0 if ci is None else (ci[1] - ci[0]) / 3.29 * rng.normal())
            columns = {"qpos.hinge": motion(size, rng)}
            found.append(Episode(columns, STEP, 10 * size))
        return found


def robot(size: float, episodes: int = 6, tracked: bool = True, **meta: str) -> list[Log]:
    """Return the logs of a robot that swings so far."""
    rng, found = np.random.default_rng(7), []
    for _ in range(episodes):
        columns = {
            "episode": np.zeros(ROWS),
            "time": np.arange(ROWS) * STEP,
            "ctrl.hinge": np.zeros(ROWS),
            "action.0": np.zeros(ROWS),
            "qpos.hinge": motion(size, rng),
            "reward": np.full(ROWS, 10 * size / ROWS),
        }
        if tracked:
            columns["sensor.position_0"] = np.zeros(ROWS)
        found.append(Log(columns, dict(meta)))
    return found


def test_a_corrected_simulator_is_nearer_and_predicts_the_return() -> None:
    """With the motor that the robot has, both distances fall to the floor; so does the return."""
    loop = check_closed_loop(robot(0.5), Swing(), WEAK, 0, FEW)
    assert loop.verdict in ("within_floor", "nearer")
    for one in loop.distances:
        assert one.corrected is not None and one.nearer is not None
        assert one.floor.value < one.nominal.value / 3
        assert one.corrected.value < one.nominal.value / 3
        assert one.nearer.ci[0] > 0
    assert loop.returns is not None and loop.returns.corrected is not None
    assert loop.returns.robot.value == pytest.approx(5.0)
    assert loop.returns.nominal.value == pytest.approx(10.0)
    assert loop.returns.corrected.value == pytest.approx(5.0, rel=0.05)


def test_with_nothing_hidden_the_simulator_as_given_is_within_the_floor() -> None:
    """The robot is no farther from its simulator than from itself; nothing is corrected."""
    loop = check_closed_loop(robot(1.0), Swing(), (), 0, FEW)
    assert loop.verdict == "within_floor"
    assert loop.distances[0].corrected is None and loop.distances[0].nearer is None


def test_a_wrong_correction_is_called_farther() -> None:
    """Effects that the robot does not have take the simulator away from it."""
    loop = check_closed_loop(robot(1.0), Swing(), WEAK, 0, FEW)
    assert loop.verdict == "farther"
    assert loop.distances[0].nearer is not None and loop.distances[0].nearer.ci[1] < 0


def test_a_simulator_that_is_off_without_known_effects_is_apart() -> None:
    """No effect was found, and the robot swings half as far."""
    assert check_closed_loop(robot(0.5), Swing(), (), 0, FEW).verdict == "apart"


def test_returns_that_nobody_knows_are_not_compared() -> None:
    """A task that pays for distance needs a tracker in the log."""
    assert check_closed_loop(robot(0.5, tracked=False), Swing(), WEAK, 0, FEW).returns is None


def test_the_same_seed_gives_the_same_numbers() -> None:
    """All randomness follows from the seed."""
    first, again, other = (
        check_closed_loop(robot(0.5), Swing(), WEAK, seed, FEW) for seed in (3, 3, 4)
    )
    assert first == again != other


def test_logs_that_cannot_be_compared_are_refused() -> None:
    """One episode, another rate, no channel in common: a sentence each."""
    with pytest.raises(Sim2RealError, match="contain 1 episode"):
        check_closed_loop(robot(0.5, episodes=1), Swing(), WEAK, 0, FEW)
    fast = Swing()
    fast.step = STEP / 2
    with pytest.raises(Sim2RealError, match=r"row every 0\.02 s"):
        check_closed_loop(robot(0.5), fast, WEAK, 0, FEW)
    others = [
        Log({n.replace("qpos.hinge", "qpos.knee"): c for n, c in log.columns.items()})
        for log in robot(0.5)
    ]
    with pytest.raises(Sim2RealError, match="no channel in common"):
        check_closed_loop(others, Swing(), WEAK, 0, FEW)


def test_only_the_logs_of_one_policy_are_taken() -> None:
    """Recordings are left out, several policies refused, and a policy that is given counts."""
    walks, plain = robot(0.5, policy="a"), [Log(dict(robot(1.0)[0].columns))]
    asked = []

    def load(path: object, task: str | None) -> Swing:
        asked.append((str(path), task))
        return Swing()

    loop = closed_loop_of([*walks, *plain], load, None, WEAK, 0, FEW)
    assert loop is not None and loop.episodes == len(walks)
    assert closed_loop_of(plain, load, None, WEAK, 0, FEW) is None
    assert closed_loop_of(walks, None, None, WEAK, 0, FEW) is None
    with pytest.raises(Sim2RealError, match="several policies"):
        closed_loop_of([*walks, *robot(0.5, policy="b")], load, None, WEAK, 0, FEW)
    closed_loop_of(robot(0.5, task="Follow"), load, "given.npz", WEAK, 0, FEW)
    assert asked == [("a", None), ("given.npz", "Follow")]


def test_histories_hold_consecutive_rows_and_headings_do_not_count() -> None:
    """A sample is rows of one episode side by side; an orientation is where gravity points."""
    columns = {
        "episode": np.repeat([0, 1], 5),
        "time": np.tile(np.arange(5) * STEP, 2),
        "ctrl.hinge": np.zeros(10),
        "qpos.hinge": np.arange(10.0),
        "quat.imu.w": np.cos(np.arange(10.0)),
        "quat.imu.x": np.zeros(10),
        "quat.imu.y": np.zeros(10),
        "quat.imu.z": np.sin(np.arange(10.0)),  # about the vertical
    }
    episodes = episodes_of([Log(columns)])
    names = shared(episodes)
    assert names == ["qpos.hinge", "gravity.imu.x", "gravity.imu.y", "gravity.imu.z"]
    samples, group = histories(episodes, names, ClosedLoopSettings(rows=3, samples=40))
    np.testing.assert_array_equal(group, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(samples[:, :3], [[k, k + 1, k + 2] for k in (0, 1, 2, 5, 6, 7)])
    np.testing.assert_allclose(samples[:, 3:], np.tile([0] * 6 + [-1] * 3, (6, 1)), atol=1e-12)


def test_a_report_keeps_it() -> None:
    """What report.json says is read back as it was."""
    loop = check_closed_loop(robot(0.5), Swing(), WEAK, 0, FEW)
    report = replace(sample.report(), closed_loop=loop)
    back = Report.from_json(report.to_json()).closed_loop
    assert back is not None and loop.returns is not None and back.returns is not None
    assert back.distances[1].floor.ci == pytest.approx(loop.distances[1].floor.ci, rel=1e-5)
    assert back.returns.robot.value == pytest.approx(loop.returns.robot.value, rel=1e-5)
    plain = check_closed_loop(robot(0.5, tracked=False), Swing(), (), 0, FEW)
    back = Report.from_json(replace(report, closed_loop=plain).to_json()).closed_loop
    assert back is not None and back.returns is None and back.distances[0].corrected is None
