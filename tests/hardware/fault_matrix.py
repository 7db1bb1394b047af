"""Faults times phases of a program that drives a robot: is torque off afterwards, and who was told?

    python -m tests.hardware.fault_matrix       # writes the table of docs/explanation/safety.md

`in_virtual_time` and `over_a_pty` run one cell each and return its `Outcome`; the tests of
`test_fault_matrix.py` assert every cell of both.
"""

import logging
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from hardware.backends import ServoBackend
from hardware.clock import VirtualClock
from hardware.config import Robot, make_robot
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.pty import serve
from hardware.emulator.world import EmulatedRobot
from hardware.episode_log import EpisodeLog
from hardware.errors import HardwareError
from hardware.log import read_logs
from hardware.stop_limits import StopLimits
from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.fault_proxy import FaultyPort, Link, PtyProxy

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "safety.md"
BEGIN, END = "<!-- fault matrix -->\n", "<!-- end of the fault matrix -->\n"
PHASES = {"arming": 21, "motion": 20, "parking": 6, "torque-off": 2}  # writes before the fault
SECONDS = {"arming": 0.03, "motion": 0.5, "parking": 0.2, "torque-off": 0.0}  # over a pty
STEPS, GOAL = 25, 0.3
LEFT_ON, MAY_STAY, STILL = "left on by an earlier program", "stay powered", "may still be powered"


class Fault(NamedTuple):
    """A row of the matrix: signals to send, or what happens to the link, and what may be left."""

    name: str
    signals: tuple[str, ...] = ()
    away: float = 0.0  # s
    changes: Mapping[str, Any] = MappingProxyType({})  # of the link
    patience: float = 4.0  # stops.return_time [s]
    leaves: str = ""  # "all" or "one": which servos may keep torque, if they were named


FAULTS = (
    *(Fault(name, (name,)) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")),
    Fault("SIGINT, SIGINT", ("SIGINT", "SIGINT")),
    Fault("SIGTERM, SIGINT", ("SIGTERM", "SIGINT")),
    Fault("SIGKILL", ("SIGKILL",), leaves="all"),
    Fault("unplugged 1.5 s", away=1.5),
    Fault("unplugged 1.5 s, SIGINT", ("SIGINT",), away=1.5),
    Fault("unplugged 9 s", away=9.0, leaves="all"),
    Fault("unplugged 9 s, `return_time: 10`", away=9.0, patience=10.0),
    Fault("40 % of chunks corrupt", changes={"corrupt": 0.4}),
    Fault("answers 150 ms late", changes={"late": 0.15}),
    Fault("one servo gone", changes={"missing": 2}, leaves="one"),
)


class Killed(BaseException):
    """What stands for SIGKILL in virtual time: nothing passes the link any more."""


@dataclass
class Outcome:
    """What a cell came to.

    Attributes:
        powered: servos that have torque at the end.
        said: what the program said.
        next_said: what the next program said first.
        rows: rows of the log on disk.
        commanded: rows that were complete when the fault struck.
        struck: whether it struck at all.
    """

    powered: list[str]
    said: str
    next_said: str
    rows: int
    commanded: int
    struck: bool

    def cell(self, fault: Fault) -> str:
        """Return the cell's words: what is left, and who was told."""
        if self.rows < self.commanded:
            return f"ROWS LOST: {self.rows} of {self.commanded}"
        named = all(name in self.said.rpartition(STILL)[0] for name in self.powered)
        if fault.leaves == "one" and "hinge2" in self.said and set(self.powered) <= {"hinge2"}:
            return "off, servo named" if STILL in self.said else "off"
        if not self.powered:
            return "off"
        again = LEFT_ON in self.next_said and all(n in self.next_said for n in self.powered)
        told = MAY_STAY in self.said if "SIGKILL" in fault.signals else named
        if fault.leaves == "all" and told and again:
            return "on: reported, and again by the next program"
        return f"TORQUE ON, AND NOBODY WAS TOLD: {self.powered}"


def robot(folder: Path, port: str | None = None) -> Robot:
    """Return three pendulums, slow enough for a busy machine where they have a port."""
    model = folder / "chain.xml"
    model.write_text(many_benches(3, ""))
    slow = {} if port is None else {"port": port, "rate": 20.0, "watchdog": 1.0}
    return make_robot(bench_data(3, model=str(model), name="chain3", **slow))


def program(backend: ServoBackend, folder: Path, phase: Callable[[str], None]) -> None:
    """Arm a robot, drive it, park it, and write its log, as `deploy` does."""
    log = EpisodeLog(backend.robot, folder)
    try:
        backend.open()
        driver = backend.guard.driver
        driver.torque_on = _announced(driver.torque_on, "arming", phase)
        driver.torque_off = _announced(driver.torque_off, "torque-off", phase)
        backend.arm()
        measured = backend.start(np.zeros(3))
        log.begin(measured)
        phase("motion")
        for _ in range(STEPS):
            goal = np.full(3, GOAL)
            sent = backend.command(goal)
            log.add(backend.written, goal, goal, sent, backend.health, backend.counters)
            measured = backend.wait()
            log.outcome(0.0, False)
            log.follow(measured)
        phase("parking")
    finally:
        try:
            log.finish({"stopped": backend.stopped})
        finally:
            backend.close()


def _announced(action: Any, name: str, phase: Callable[[str], None]) -> Any:
    """Return the action with its phase announced before."""

    def announced(*words: Any) -> Any:
        phase(name)
        return action(*words)

    return announced


@contextmanager
def listening() -> Iterator[list[str]]:
    """Gather what the hardware says."""
    said: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: said.append(record.getMessage())
    logger = logging.getLogger("hardware")
    before = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    logger.propagate = False
    try:
        yield said
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before[0])
        logger.propagate = before[1]


class _Backend(ServoBackend):
    """A backend whose bus is behind a link."""

    port: FaultyPort

    def make_driver(self) -> Driver:
        return Driver(self.robot, self.port, self.port.clock)


class _Striker:
    """Lets a fault strike after so many writes of a phase, and counts the rows until then."""

    def __init__(self, fault: Fault, phase: str, port: FaultyPort, folder: Path) -> None:
        self._fault, self._wanted, self._port, self._folder = fault, phase, port, folder
        self._phase, self._writes, self._signals = "", 0, list(fault.signals)
        self.struck, self.rows = False, 0

    def phase(self, name: str) -> None:
        """Take note of the phase that begins."""
        self._phase, self._writes = name, 0

    def on_write(self) -> None:
        """Strike if the time has come; a second signal comes two writes after the first."""
        self._writes += 1
        if self.struck:
            if self._signals and self._writes > 2:
                self._send()
        elif self._phase == self._wanted and self._writes == PHASES[self._wanted]:
            self.struck, self._writes = True, 0
            self.rows = rows_in(self._folder)
            link, now = self._port.link, self._port.clock.now()
            link.back = now + self._fault.away if self._fault.away else link.back
            for name, value in self._fault.changes.items():
                setattr(link, name, value)
            if self._signals and not self._fault.away:
                self._send()

    def _send(self) -> None:
        name = self._signals.pop(0)
        if name != "SIGKILL":
            return os.kill(os.getpid(), getattr(signal, name))
        self._port.link.dead = True
        shutil.copytree(self._folder, self._folder.with_name("killed"))
        raise Killed


def rows_in(folder: Path) -> int:
    """Return the whole rows of the log in a folder, finished or not; 0 for fewer than two."""
    lines = [f.read_text().count("\n") - 1 for f in folder.glob("*.csv*")]
    return sum(n for n in lines if n > 1)


def in_virtual_time(fault: Fault, phase: str, folder: Path) -> Outcome:
    """Run one cell over the emulated bus in this process."""
    logs, clock, link = folder / "logs", VirtualClock(), Link()
    logs.mkdir()
    machine = robot(folder)
    world = EmulatedRobot(machine)
    stops = StopLimits(return_time=fault.patience)
    backend = _Backend(machine, 0.1, world, limits=stops, clock=clock)
    backend.port = port = FaultyPort(world, clock, link)
    striker = _Striker(fault, phase, port, logs)
    port.on_write = striker.on_write
    with listening() as said:
        try:
            program(backend, logs, striker.phase)
        except (HardwareError, KeyboardInterrupt, SystemExit, Killed) as error:
            said.append(str(error))
    killed = folder / "killed"
    rows = read_back(killed if killed.is_dir() else logs)
    now = max(clock.now(), world.time, link.back) + 1.0
    world.advance(now)
    powered = [s.name for s, on in zip(machine.servos, world.firmware.torque_on, strict=True) if on]
    with listening() as after:
        clock.sleep_until(now)
        following = Driver(machine, LoopbackPort(world, clock), clock)
        following.connect()
        following.configure()
    assert not world.firmware.torque_on.any()
    first = after[0] if after else ""
    return Outcome(powered, "\n".join(said), first, rows, striker.rows, striker.struck)


def read_back(folder: Path) -> int:
    """Return how many rows a reader gets of a folder."""
    return sum(map(len, read_logs(folder))) if rows_in(folder) else 0


def over_a_pty(fault: Fault, phase: str, folder: Path) -> Outcome:
    """Run one cell in real time: emulator and proxy here, the program as a process of its own."""
    logs, link = folder / "logs", Link()
    logs.mkdir()
    port, over = folder / "port", threading.Event()
    devices: dict[str, str] = {}
    there = threading.Event()
    world = EmulatedRobot(robot(folder))

    def ready(found: dict[str, str]) -> None:
        devices.update(found)
        there.set()

    emulator = threading.Thread(target=serve, args=(world, ready, over.is_set), daemon=True)
    emulator.start()
    there.wait(10)
    words = [sys.executable, "-m", "tests.hardware.fault_matrix", "program", str(folder)]
    try:
        with PtyProxy(devices[""], port, link):
            process = subprocess.Popen(
                [*words, str(fault.patience)], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                text=True, cwd=ROOT,
            )  # fmt: skip
            rows, struck = _strike(process, fault, phase, link, logs)
            _, said = process.communicate(timeout=120)
            time.sleep(max(link.back - time.monotonic(), 0.0) + 0.5)
            on = world.firmware.torque_on.tolist()
            link.late, link.corrupt, link.missing = 0.0, 0.0, None
            following = [*words[:3], "next", str(folder)]
            after = subprocess.run(following, capture_output=True, text=True, cwd=ROOT)
            first = after.stderr.partition("\n")[0]
    finally:
        over.set()
        emulator.join()
    powered = [s.name for s, one in zip(world.robot.servos, on, strict=True) if one]
    return Outcome(powered, said, first, read_back(logs), rows, struck)


def _strike(
    process: subprocess.Popen, fault: Fault, phase: str, link: Link, logs: Path
) -> tuple[int, bool]:
    """Wait for a phase, let the fault strike, and return the rows until then and whether it did."""
    assert process.stdout is not None
    if not any(line.strip() == phase for line in process.stdout):
        return 0, False
    time.sleep(SECONDS[phase])
    rows = rows_in(logs)
    if fault.away:
        link.back = time.monotonic() + fault.away
    for name, value in fault.changes.items():
        setattr(link, name, value)
    for i, name in enumerate(fault.signals):
        time.sleep(0.5 if fault.away else 0.02 * i)
        process.send_signal(getattr(signal, name))
    return rows, True


def run_program(folder: Path, patience: float) -> None:
    """Be the program of `over_a_pty`."""
    machine = robot(folder, str(folder / "port"))
    limits = StopLimits(misses=20, patience=5.0, return_time=patience, lost=1.0, stale=1.0)
    backend = ServoBackend(machine, 0.1, limits=limits)
    program(backend, folder / "logs", _mark)


def _mark(phase: str) -> None:
    """Tell whoever started this program which phase begins."""
    sys.stdout.write(f"{phase}\n")
    sys.stdout.flush()


def run_next(folder: Path) -> None:
    """Be the next program that opens the port."""
    driver = ServoBackend(robot(folder, str(folder / "port")), 0.1).make_driver()
    driver.connect()
    driver.configure()
    driver.close()


def table() -> str:
    """Return the matrix in virtual time as Markdown."""
    lines = ["| fault | " + " | ".join(PHASES) + " |", "|---" * (len(PHASES) + 1) + "|"]
    for fault in FAULTS:
        cells = []
        for phase in PHASES:
            with tempfile.TemporaryDirectory() as folder:
                cells.append(in_virtual_time(fault, phase, Path(folder)).cell(fault))
        lines.append(f"| {fault.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(words: list[str]) -> None:
    """Write the table, or be one of the programs of `over_a_pty`."""
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    if words[:1] == ["program"]:
        return run_program(Path(words[1]), float(words[2]))
    if words[:1] == ["next"]:
        return run_next(Path(words[1]))
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    _, _, tail = rest.partition(END)
    PAGE.write_text(head + BEGIN + table() + END + tail, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
