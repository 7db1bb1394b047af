"""An emulated arm at a device file, and the hands of a person beside it.

with Bench(EmulatedRobot(robot)) as bench:
    bench.connect_only("gripper")           # the other servos' cables are out
    bench.pose({"gripper": 0.5})            # joints are held there, their torque off
    bench.device                            # what clients open
"""

from __future__ import annotations

import itertools
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hardware.emulator.pty import serve
from hardware.emulator.world import EmulatedRobot

STEPS = 10


class Bench:
    """A world that a thread serves; what hands do is done between two of its steps.

    Args:
        world: the emulated robot, of one bus.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        self.world, self.device = world, ""
        self._over, self._open = threading.Event(), threading.Event()
        self._tasks: queue.Queue[tuple[Callable[[], Any], queue.Queue]] = queue.Queue()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Bench:
        self._thread.start()
        assert self._open.wait(30)
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join(10)

    def _serve(self) -> None:
        def ready(devices: dict[str, str]) -> None:
            (self.device,) = devices.values()
            self._open.set()

        def stopped() -> bool:
            while not self._tasks.empty():
                task, answer = self._tasks.get()
                answer.put(task())
            return self._over.is_set()

        serve(self.world, ready, stopped)

    def do(self, task: Callable[[], Any]) -> Any:
        """Do something to the world between two of its steps, and return what it returned."""
        answer: queue.Queue = queue.Queue()
        self._tasks.put((task, answer))
        return answer.get(timeout=60)

    def connect_only(self, *names: str) -> None:
        """Take out the cables of all servos but these; none named: put all in."""
        robot, world = self.world.robot, self.world

        def task() -> None:
            for name, servo in zip(robot.names, world.servos, strict=True):
                servo.silent_until = 0.0 if name in names or not names else math.inf

        self.do(task)

    def pose(self, angles: Mapping[str, float]) -> None:
        """Put joints at angles [rad] and hold all of the arm, until its servos have torque."""
        world, names = self.world, self.world.robot.names

        def task() -> None:
            data, places = world.mechanics.data, world.mechanics.qpos
            for name, angle in angles.items():
                data.qpos[places[names.index(name)]] = angle
            data.qvel[:] = 0.0
            world._held[:] = True
            world._let_go()

        self.do(task)

    def sweep(self, name: str, angles: tuple[float, ...], seconds: float = 0.2) -> None:
        """Move one joint by hand through angles [rad], from each to the next in so many seconds."""
        for begin, end in itertools.pairwise(angles):
            for angle in np.linspace(begin, end, STEPS):
                self.pose({name: float(angle)})
                time.sleep(seconds / STEPS)

    @property
    def angles(self) -> dict[str, float]:
        """Where the joints are [rad], by their servos' names."""
        return self.do(lambda: dict(zip(self.world.robot.names, self._angles(), strict=True)))

    def _angles(self) -> list[float]:
        return self.world.mechanics.angle.tolist()
