"""Walks whose base nobody measured, and how an answer is scored."""

import numpy as np
import pytest

from benchmarks import ground
from benchmarks.ground import drawn, scored
from benchmarks.ground_walks import WALKERS, walks
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from sim2real.diagnosis.diagnose import diagnose
from sim2real.diagnosis.schema import Cause, Equivalent, GapMetrics, Report, Unexplained


def answer(verdict: str, *causes: Cause) -> Report:
    """Return a report with a verdict and causes."""
    gap = GapMetrics("rad", 0.02, 0.002, 0.001, 0.9, (0.8, 0.95), True)
    return Report(verdict, gap, (), causes, Unexplained(0.1, "none"))  # type: ignore[arg-type]


def cause(effect: str, where: str | None, *alike: Equivalent) -> Cause:
    """Return a cause with its equivalents."""
    return Cause(effect, where, None, 0.1, (0.0, 0.2), "", {}, 0.9, 0.9, equivalent=alike)


@pytest.mark.slow
def test_walks_hold_encoders_and_imu_and_half_begin_in_mid_gait() -> None:
    """Nothing of the base's position, nothing of the policy."""
    first, second = walks("quad8", [], 1, episodes=2)
    assert not [n for n in first.columns if n.startswith(("sensor.position", "obs.", "qpos.root"))]
    assert "quat.imu.w" in first.columns
    assert first.time[0] == second.time[0] == 0.0
    assert second.time[-1] < first.time[-1]
    assert np.ptp(first.column("qpos.knee_fl")) > 0.1
    assert abs(second.column("qvel.knee_fl")[0]) + abs(second.column("qvel.hip_fr")[0]) > 0.1


def test_draws_are_sealed_by_their_seed() -> None:
    """And hide every kind of effect."""
    robot = load_robot("quad8")
    keys = [drawn(robot, np.random.default_rng([5, k])) for k in range(40)]
    assert keys == [drawn(robot, np.random.default_rng([5, k])) for k in range(40)]
    assert {entry["effect"] for key in keys for entry in key} == {
        *("coulomb_friction", "motor_strength", "command_delay", "ground_friction", "payload"),
        *("viscous_friction", "imu_mounting", "imu_delay", "gyro_bias"),
    }
    assert [] in keys


@pytest.mark.parametrize("name", WALKERS)
def test_each_robot_can_hide_what_is_drawn(name: str) -> None:
    """The emulator takes every key."""
    robot = load_robot(name)
    for number in range(20):
        key = drawn(robot, np.random.default_rng([5, number]))
        EmulatedRobot(robot, hidden=make_hidden(key, robot))


ALIKE = cause("armature", "hip_fl", Equivalent("coulomb_friction", "hip_fl"))


@pytest.mark.parametrize(
    ("report", "right", "wrong", "more"),
    [
        (answer("explained", cause("coulomb_friction", "hip_fl")), 1, 0, 0),
        (answer("explained", cause("coulomb_friction", "hip_fr")), 0, 1, 1),
        (answer("unexplained"), 0, 0, 0),
        (answer("explained", ALIKE, cause("payload", "hip_br")), 1, 0, 1),
    ],
)
def test_an_answer_is_right_where_the_first_cause_is(report: Report, right, wrong, more) -> None:
    """Or what cannot be told from it; a false explanation and further causes are counted."""
    row = scored(report, [{"effect": "coulomb_friction", "where": "hip_fl", "value": 0.1}])
    assert (row["right"], row["explained_wrong"], row["superfluous"]) == (right, wrong, more)


def test_a_sound_robot_has_no_gap() -> None:
    """Anything else is an alarm."""
    assert scored(answer("no_gap"), [])["right"] == 1
    found = scored(answer("explained", cause("payload", "hip_br")), [])
    assert (found["right"], found["explained_wrong"], found["superfluous"]) == (0, 1, 1)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["quad8", "quad12"])
def test_friction_at_a_knee_is_named_with_its_value(robot: str) -> None:
    """0.15 N·m, in walks whose base nobody measured, half of them begun in mid-gait."""
    key = [{"effect": "coulomb_friction", "where": "knee_fl", "value": 0.15}]
    report = diagnose(walks(robot, key, 11))
    assert report.verdict == "explained"
    (found,) = report.causes
    assert (found.effect, found.where) == ("coulomb_friction", "knee_fl")
    assert found.value_ci[0] < 0.15 < found.value_ci[1]


def test_the_walks_of_development_are_told_by_a_command(monkeypatch, capsys) -> None:
    """A row each: what was hidden, what was excluded, what was found; the same seed for all."""
    asked: list = []

    def walked(name: str, key: list, seed: int) -> list:
        asked.append((name, seed))
        return key

    def diagnosed(logs: list, exclude: tuple[str, ...]) -> Report:
        named = [one for one in logs if one["effect"] not in exclude]
        return answer("no_gap" if not logs else "explained", *(
            cause(one["effect"], one["where"]) for one in named
        ))  # fmt: skip

    monkeypatch.setattr(ground, "walks", walked)
    monkeypatch.setattr(ground, "diagnose", diagnosed)
    assert ground.main(["--development"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert asked == [("quad8", ground.DEVELOPED)] * len(ground.DEVELOPMENT)
    assert ground.main(["--development", "--robot", "quad12"]) == 0
    assert asked[-1] == ("quad12", ground.DEVELOPED)
    assert rows[0].startswith("nothing | robot | 0 |  | no_gap")
    assert (
        "coulomb_friction knee_fl 0.1" in rows[1] and "coulomb_friction knee_fl 0.1" not in rows[-1]
    )
