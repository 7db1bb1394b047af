"""An emulated robot behind device files until it is stopped: the verb emulate.

What a person would do by hand is typed: `connect elbow`, `move elbow 0.5`
(`hardware/emulator/hand.py`).
"""

import math
import os
import select
import signal
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

from hardware.command_line import Keys, number, yes_or_no
from hardware.config import Robot
from hardware.emulator.hand import Hand, as_delivered
from hardware.emulator.pty import check_link, serve
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from hardware.imu.rvc import BAUD
from hardware.terminal import Tell


def emulate(robot: Robot, keys: Keys, tell: Tell) -> None:
    """Serve an emulated robot at a device file until it is stopped, also in the background.

    Args:
        robot: the robot.
        keys: `link`, `hidden`, `held`, `factory`, `seconds` and `seed`, as the help explains them.
        tell: shows a line.

    Raises:
        HardwareError: a value or a file that is wrong.
    """
    link = Path(keys["link"]) if "link" in keys else None
    hidden = Path(keys["hidden"]) if "hidden" in keys else robot.hidden
    held, factory = yes_or_no(keys, "held", True), yes_or_no(keys, "factory", False)
    if link is not None:
        check_link(link)
    robot = replace(robot, hidden=hidden)
    robot = as_delivered(robot) if factory else robot
    world = EmulatedRobot(robot, seed=int(number(keys, "seed", 0)))
    if held:
        world.hold()
    for i in range(len(robot.servos) if factory else 0):
        world.connect(i, False)
    end = time.perf_counter() + number(keys, "seconds", math.inf)
    stop, back = threading.Event(), threading.Event()
    person = TypedHand(Hand(world), tell)

    def ready(devices: dict[str, str]) -> None:
        bauds = {bus.name: bus.baud for bus in robot.buses} or {"": robot.bus.baud}
        for place, (name, device) in enumerate(devices.items(), 1):
            words = f"{robot.name} {name}".rstrip()
            last = "; Ctrl-C ends it" if place == len(devices) else ""
            tell(f"{words} at {device}, {bauds.get(name, BAUD)} bits/s{last}")

    def stopped() -> bool:
        if back.is_set():
            back.clear()
            world.hold()
        person.step()
        return stop.is_set() or time.perf_counter() > end

    events = {signal.SIGUSR1: back, signal.SIGTERM: stop}
    events[signal.SIGINT] = stop  # a shell's background jobs ignore it by default
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # unless it runs under nohup
        events[signal.SIGHUP] = stop
    before = {
        event: signal.signal(event, lambda n, _: events[signal.Signals(n)].set())
        for event in events
    }
    try:
        serve(world, ready, stopped, link)
    finally:
        for event, handler in before.items():
            signal.signal(event, handler)


class TypedHand:
    """A hand that obeys what is typed, without ever waiting for it.

    Args:
        hand: the hand.
        tell: shows what it did.
    """

    def __init__(self, hand: Hand, tell: Tell) -> None:
        self._hand, self._tell = hand, tell
        self._typed, self._open = b"", sys.stdin is not None

    def step(self) -> None:
        """Take what was typed, and move on."""
        if self._open and self._is_ours() and select.select([0], [], [], 0)[0]:
            data = os.read(0, 4096)
            self._typed, self._open = self._typed + data, bool(data)
        while b"\n" in self._typed:
            line, _, self._typed = self._typed.partition(b"\n")
            self._obey(line.decode(errors="replace"))
        if (done := self._hand.step()) is not None:
            self._tell(done)

    def _obey(self, line: str) -> None:
        try:
            done = self._hand.obey(line) if line.strip() else None
        except RobotError as error:
            done = str(error)
        if done is not None:
            self._tell(done)

    @staticmethod
    def _is_ours() -> bool:
        """Say whether what is typed is for this program: a job in the background is stopped."""
        return not os.isatty(0) or os.tcgetpgrp(0) == os.getpgrp()
