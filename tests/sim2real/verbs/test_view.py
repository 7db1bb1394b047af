"""The live view: everything but the window, and the film where there is no display."""

import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hardware.config import load_robot
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from sim2real.deployment import view
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs import view as verb
from tests.sim2real.trained import SMALL_ES, run_verb, train


class Handle:
    """A window that is closed after some pictures, and remembers what it showed."""

    def __init__(self, world: EmulatedRobot, pictures: int) -> None:
        self.world, self.left = world, pictures
        self.angles: list[float] = []

    def is_running(self) -> bool:
        """Say whether the window is open."""
        return self.left > 0

    def sync(self) -> None:
        """Draw."""
        self.left -= 1
        self.angles.append(float(self.world.mechanics.angle[0]))


def go(out: Path, *words: str, **changes: Any) -> Path | None:
    """View as the command line does."""
    overrides = ["run=view", "robot=bench1", "motions=[ramp]", "seconds=1.0", *words]
    return run_verb(overrides, out, **changes)


@pytest.fixture
def window(monkeypatch) -> dict[str, Any]:
    """Stand a handle in for the window; `pictures` says after how many it is closed."""
    made: dict[str, Any] = {"pictures": 10**9}

    @contextmanager
    def opened(world: EmulatedRobot):
        made["world"], made["handle"] = world, Handle(world, made["pictures"])
        yield made["handle"]

    monkeypatch.setattr(verb, "open_window", opened)
    monkeypatch.setenv("DISPLAY", ":7")
    return made


def test_the_robot_moves_before_our_eyes_in_real_time(window, tmp_path):
    """Fifty pictures a second of the robot that the bus moves; in the end it is off."""
    start = time.perf_counter()
    go(tmp_path)
    angles = np.array(window["handle"].angles)
    assert len(angles) == 51
    assert np.ptp(angles) > 0.05
    assert time.perf_counter() - start > 0.95
    assert not window["world"].firmware.torque_on.any()


def test_a_closed_window_ends_it(window, tmp_path):
    """The robot is parked and switched off, without more pictures."""
    window["pictures"] = 12
    go(tmp_path, "seconds=1000")
    assert len(window["handle"].angles) == 12
    assert not window["world"].firmware.torque_on.any()


def test_a_policy_drives_it(window, tmp_path):
    """Episode after episode of the checkpoint's task, its way to the start included."""
    run = train(tmp_path / "run", SMALL_ES)
    go(tmp_path, f"checkpoint={run}", "seconds=1.5")
    assert len(window["handle"].angles) == 76
    assert np.ptp(window["handle"].angles) > 0.02
    with pytest.raises(RobotError, match="task of the robot 'bench1'"):
        go(tmp_path, f"checkpoint={run}", "robot=quad8")


def test_without_a_display_it_says_so(tmp_path, monkeypatch):
    """One sentence, and what to do instead; real robots and no time are refused as well."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(view.sys, "platform", "linux")
    with pytest.raises(Sim2RealError, match=r"there is no display; .* add video=film"):
        go(tmp_path)
    with pytest.raises(Sim2RealError, match="seconds=0"):
        go(tmp_path, "seconds=0")
    with pytest.raises(Sim2RealError, match="view shows emulated robots; bench1 is at /dev/x"):
        go(tmp_path, "robot.port=/dev/x")


def test_a_watched_clock_keeps_the_time_of_an_unwatched_one():
    """Whoever looks changes neither the time nor how far a sleep goes."""

    class Blind:
        every = 0.02

        def show(self, world: EmulatedRobot) -> None:
            pass

    clock = view.RenderingClock(EmulatedRobot(load_robot("bench1")), Blind(), end=0.5)
    for moment in (0.013, 0.2, 0.1, 0.30001):
        before = clock.now()
        clock.sleep_until(moment)
        assert clock.now() == max(moment, before)
    with pytest.raises(view.WindowClosedError):
        clock.sleep_until(1.0)
    clock.sleep_until(2.0)
    assert clock.now() == 2.0


@pytest.mark.slow
@pytest.mark.render
def test_a_film_of_it(tmp_path):
    """video=film needs no display."""
    film = go(tmp_path, "video=film", "seconds=0.4")
    assert film is not None
    assert film.stat().st_size > 2000
