"""Mistakes of logs: what each does to the columns, and which are drawn."""

import numpy as np
import pytest

from hardware.log import Log
from sim2real.exam.log_mistakes import KINDS, Mistake, draw_mistake

TIME = np.arange(100) * 0.02
WAVE, OTHER = np.sin(5 * TIME), np.cos(3 * TIME)


def swings(joints: str = "ab") -> Log:
    """Return waves of two joints, with speeds and stamps."""
    columns = {"episode": np.zeros(100), "time": TIME}
    for joint, wave in zip(joints, (WAVE, OTHER), strict=False):
        columns |= {f"{kind}.{joint}": wave for kind in ("ctrl", "qpos")}
        columns |= {f"qvel.{joint}": np.gradient(wave, TIME), f"stamp.{joint}": TIME - 0.001}
    return Log(columns)


def test_a_late_command_stands_in_the_row_after_its_own() -> None:
    """Every joint's; readings stay."""
    log = Mistake("row_shift", ("ctrl",), None, 1.0).apply(swings())
    for joint in "ab":
        right = swings().column(f"ctrl.{joint}")
        assert np.array_equal(log.column(f"ctrl.{joint}")[1:], right[:-1])
        assert np.array_equal(log.column(f"qpos.{joint}"), right)


def test_an_early_reading_is_that_of_the_next_row_with_its_speed() -> None:
    """A client that reads after it has waited."""
    log = Mistake("row_shift", ("qpos",), "a", -1.0).apply(swings())
    for name in ("qpos.a", "qvel.a"):
        assert np.array_equal(log.column(name)[:-1], swings().column(name)[1:])
    assert np.array_equal(log.column("qpos.b"), OTHER)


@pytest.mark.parametrize(
    ("mistake", "position", "speed"),
    [
        (Mistake("reversal", ("qpos",), "a", -1.0), -WAVE, -1.0),
        (Mistake("scale", ("qpos",), "a", 0.25), 0.25 * WAVE, 0.25),
        (Mistake("unit", ("qpos",), "a", 180 / np.pi), np.degrees(WAVE), 180 / np.pi),
        (Mistake("offset", ("qpos",), "a", 0.3), WAVE + 0.3, 1.0),
        (Mistake("turn", ("qpos",), "a", -1.0), WAVE - 2 * np.pi, 1.0),
        (Mistake("turn", ("qpos",), "a", 1.0, seconds=1.0), WAVE + 2 * np.pi * (TIME >= 1.0), 1.0),
        (Mistake("column_map", ("qpos",), "a", 1.0, "b"), WAVE + OTHER, None),
    ],
    ids=lambda value: value.kind if isinstance(value, Mistake) else "",
)
def test_a_reading_is_wrong_with_its_speed(mistake: Mistake, position: np.ndarray, speed) -> None:
    """By the table of the module; the command stays as it was sent."""
    right, log = swings(), mistake.apply(swings())
    assert log.column("qpos.a") == pytest.approx(position)
    moves = right.column("qvel.a") + right.column("qvel.b")
    wanted = moves if speed is None else speed * right.column("qvel.a")
    assert log.column("qvel.a") == pytest.approx(wanted)
    assert np.array_equal(log.column("ctrl.a"), WAVE)


def test_two_columns_are_exchanged() -> None:
    """Of commands alone."""
    log = Mistake("swap", ("ctrl",), "a", 1.0, "b").apply(swings())
    assert np.array_equal(log.column("ctrl.a"), OTHER)
    assert np.array_equal(log.column("ctrl.b"), WAVE)
    assert np.array_equal(log.column("qpos.a"), WAVE)


def test_a_wrong_clock_counts_stamps_too() -> None:
    """Both are the same program's."""
    log = Mistake("clock", ("time",), None, 0.8).apply(swings())
    assert log.time == pytest.approx(0.8 * TIME)
    assert log.column("stamp.a") == pytest.approx(0.8 * (TIME - 0.001))


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_drawn_changes_the_log_and_is_no_effect_of_a_robot(kind: str) -> None:
    """No late reading, no early command, no offset of both: effects have these names."""
    for seed in range(20):
        mistake = draw_mistake(np.random.default_rng(seed), swings(), kind)
        assert mistake.kind == kind
        broken = mistake.apply(swings())
        assert any(not np.array_equal(broken.column(n), v) for n, v in swings().columns.items())
        if kind == "row_shift":
            assert (mistake.value > 0) == (mistake.columns == ("ctrl",))
        if kind in ("offset", "turn"):
            assert len(mistake.columns) == 1
        assert Mistake.from_json(mistake.to_json()) == mistake
        assert mistake.describe().startswith(kind)


def test_a_robot_of_one_joint_has_no_mistake_of_two() -> None:
    """Drawn freely, every other kind comes."""
    rng = np.random.default_rng(0)
    kinds = {draw_mistake(rng, swings("a")).kind for _ in range(200)}
    assert kinds == set(KINDS) - {"swap", "column_map"}


def test_the_same_generator_draws_the_same_mistakes() -> None:
    """And another one others."""
    one, again, other = (
        [draw_mistake(rng, swings()) for _ in range(20)]
        for rng in map(np.random.default_rng, (1, 1, 2))
    )
    assert one == again != other
