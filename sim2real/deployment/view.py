"""The emulated robot live in a window, driven over its emulated bus.

    python -m sim2real run=view robot=quad8                            # along the motions of record
    python -m sim2real run=view robot=quad8 checkpoint=outputs/train/quad8_es/2026-11-21_10-00-00
    python -m sim2real run=view robot=quad8 checkpoint=RUN video=film  # no display: a film instead

What is seen is the robot that the driver talks to, hidden effects and all, not the model that the
policy was trained in; also while it is armed, goes to its start, and parks.
"""

import logging
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from envs.tasks.servo import ServoTask
from hardware.backends import ServoBackend
from hardware.clock import VirtualClock
from hardware.config import Robot
from hardware.emulator.world import EmulatedRobot
from hardware.excite import Kind, allowed_motions, excite
from hardware.record import record
from sim2real.deployment.robot_env import on_robot, play, robot_of
from sim2real.deployment.stops import make_stop_limits
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.video import Camera, write_mp4

log = logging.getLogger(__name__)
FPS = 50  # pictures a second in the window
SETTLE = 0.5  # s between going to the start and an episode


class WindowClosedError(Exception):
    """The window was closed."""


class Screen(Protocol):
    """Something that shows the emulated robot; `every` [s] is the time between two pictures."""

    every: float

    def show(self, world: EmulatedRobot) -> None:
        """Show the robot as it is now; raises Closed once the window is closed."""
        ...


class RenderingClock(VirtualClock):
    """A virtual clock that shows the robot whenever a picture is due.

    Args:
        world: the emulated robot.
        screen: where it is shown.
        end: the time at which the view ends [s].
    """

    def __init__(self, world: EmulatedRobot, screen: Screen, end: float) -> None:
        super().__init__()
        self._world, self._screen, self._end, self._due = world, screen, end, 0.0
        self._over = False

    def sleep_until(self, moment: float) -> None:
        """Go on to `moment` [s], picture by picture.

        Raises:
            Closed: the window was closed, or the time is over; once, so that the robot can then be
                stopped as always.
        """
        while not self._over and self._due <= moment:
            super().sleep_until(self._due)
            self._world.advance(self._due)
            self._over = self._due >= self._end
            self._due += self._screen.every
            try:
                self._screen.show(self._world)
            except WindowClosedError:
                self._over = True
                raise
            if self._over:
                raise WindowClosedError
        super().sleep_until(moment)


class Window:
    """MuJoCo's viewer, in real time.

    Args:
        handle: what `mujoco.viewer.launch_passive` returned.
    """

    every = 1 / FPS

    def __init__(self, handle: Any) -> None:
        self._handle = handle
        self._start: float | None = None

    def show(self, world: EmulatedRobot) -> None:
        """Wait until the robot's time is the wall's, and draw."""
        if not self._handle.is_running():
            raise WindowClosedError
        now = time.perf_counter()
        self._start = now - world.time if self._start is None else self._start
        time.sleep(max(self._start + world.time - now, 0.0))
        self._handle.sync()


class Film:
    """Pictures of the robot, kept.

    Args:
        camera: what draws.
        fps: frames per second.
    """

    def __init__(self, camera: Camera, fps: int) -> None:
        self.every, self.frames = 1 / fps, list[np.ndarray]()
        self._camera = camera

    def show(self, world: EmulatedRobot) -> None:
        """Draw one picture."""
        self.frames.append(self._camera.draw(world.mechanics.model, world.mechanics.data))


def watch(
    world: EmulatedRobot,
    screen: Screen,
    seconds: float,
    drive: Callable[[ServoBackend], None],
    stops: dict[str, float] | None,
) -> None:
    """Drive the emulated robot and show it, until it is over or the window is closed."""
    clock = RenderingClock(world, screen, seconds)
    backend = ServoBackend(world.robot, SETTLE, world, limits=make_stop_limits(stops), clock=clock)
    try:
        drive(backend)
    except WindowClosedError:
        log.info("simulated %.1f s", clock.now())
    finally:
        backend.close()


def write_film(
    world: EmulatedRobot,
    size: tuple[int, int],
    fps: int,
    seconds: float,
    drive: Callable[[ServoBackend], None],
    stops: dict[str, float] | None,
    path: Path,
) -> Path:
    """Film the emulated robot in pictures of a width and height [px], and return the film."""
    model = world.mechanics.model
    cameras = [model.camera(i).name for i in range(model.ncam)]
    with Camera(model, *size, cameras[0] if cameras else None) as camera:
        film = Film(camera, fps)
        watch(world, film, seconds, drive, stops)
    pictures = np.stack(film.frames)  # (n, h, w, 3)
    even = [size - size % 2 for size in pictures.shape[1:3]]  # as video codecs want them
    write_mp4(path, pictures[:, : even[0], : even[1]], fps)
    log.info("video: %s", path)
    return path


def motion_driver(
    robot: Robot, motions: list[Kind], seconds: float, seed: int
) -> Callable[[ServoBackend], None]:
    """Return a driver that repeats motions."""
    rng, kinds = np.random.default_rng(seed), allowed_motions(robot, motions)

    def drive(backend: ServoBackend) -> None:
        backend.arm()
        guard = backend.guard
        pose = np.clip(guard.measure().position, guard.low, guard.high)
        while True:
            record(guard, excite(robot, pose, seconds, kinds, rng))

    return drive


def policy_driver(
    task: ServoTask, trained: TrainedPolicy, seed: int
) -> Callable[[ServoBackend], None]:
    """Return a driver that runs a policy, episode after episode."""
    rng = np.random.default_rng(seed)

    def drive(backend: ServoBackend) -> None:
        env = on_robot(trained, task, backend)
        rows, actor = robot_of(env), trained.acting(env)
        while rows.stopped is None:
            play(env, actor, int(rng.integers(2**63)))
        raise Sim2RealError(f"the guard stopped the robot: {rows.stopped}")

    return drive


def check_display() -> None:
    """Refuse a window where none can be opened.

    Raises:
        Sim2RealError: no display.
    """
    linux = sys.platform.startswith("linux")
    if linux and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise Sim2RealError(
            "view opens a window, but there is no display; run it on a desktop, or add video=film "
            "for a film"
        )


def open_window(world: EmulatedRobot) -> Any:
    """Open MuJoCo's viewer of an emulated robot."""
    from mujoco import viewer  # here: it needs a display

    return viewer.launch_passive(world.mechanics.model, world.mechanics.data)
