"""What does a control step over the bus cost? The driver and its guard beside the SDK's bare calls.

    python -m benchmarks.bus                       # two minutes
    python -m benchmarks.bus --servos 3 --steps 200

A chain of pendulums, 50 steps a second, over the emulated bus in virtual time. In turns: the
emulator alone, the SDK's own group write and fast group read over it, our driver, and the driver
with its guard, which checks every reading, limits every command and asks one servo's health a step.
The cost is processor time, the emulator's included; median of several rounds.
"""

import copy
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import yaml
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler

from benchmarks.study import at_least, command
from hardware.clock import VirtualClock
from hardware.config import ROBOTS, Robot, make_robot
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.pace import FixedRate
from hardware.safety import Guard
from hardware.timing import BLOCK, BLOCK_SIZE
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

RATE = 50.0  # steps a second
GOAL = 116  # address of goal_position
ROUNDS = 3
Step = Callable[[np.ndarray], None]  # of goals [rad], (n,)


def chain(count: int, folder: Path) -> Robot:
    """Return a robot of so many pendulums like bench1's, its model written into a folder."""
    bodies = "".join(
        f'<body pos="0 {0.1 * i} 0.3"><joint name="hinge{i}" axis="0 -1 0" armature="0.0018"/>'
        '<geom type="sphere" pos="0 0 -0.12" size="0.012" mass="0.1" contype="0" conaffinity="0"/>'
        "</body>"
        for i in range(count)
    )
    actuators = "".join(f'<position name="hinge{i}" joint="hinge{i}"/>' for i in range(count))
    model = folder / "chain.xml"
    world = f"<worldbody>{bodies}</worldbody><actuator>{actuators}</actuator>"
    write_text(model, f'<mujoco><option integrator="implicitfast"/>{world}</mujoco>')
    data = yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8"))
    hinge = data["servos"]["hinge"]
    servos = {f"hinge{i}": copy.deepcopy(hinge) | {"id": i + 1} for i in range(count)}
    return make_robot(data | {"model": str(model), "name": "chain", "servos": servos})


def driver(robot: Robot) -> Driver:
    """Return the driver of an emulated robot whose torque is on."""
    clock = VirtualClock()
    made = Driver(robot, LoopbackPort(EmulatedRobot(robot), clock), clock)
    made.connect()
    made.configure()
    made.torque_on(made.read().count)
    return made


def alone(robot: Robot, made: Driver) -> Step:
    """Return a step in which nothing is on the bus: the clock moves, and the robot with it."""
    port = made.bus_client.port
    assert isinstance(port, LoopbackPort)

    def step(goals: np.ndarray) -> None:
        port.world.advance(made.clock.now())

    return step


def bare(robot: Robot, made: Driver) -> Step:
    """Return a step of the SDK's own group calls: goals out, then one fast read of all servos."""
    port, handler = made.bus_client.port, PacketHandler(2.0)
    write = GroupSyncWrite(port, handler, GOAL, 4)
    read = GroupSyncRead(port, handler, BLOCK, BLOCK_SIZE)
    for servo in robot.servos:
        read.addParam(servo.id)

    def step(goals: np.ndarray) -> None:
        write.clearParam()
        for servo, goal in zip(robot.servos, goals, strict=True):
            write.addParam(servo.id, servo.count(float(goal)).to_bytes(4, "little"))
        write.txPacket()
        if read.fastSyncRead() != COMM_SUCCESS:
            raise RuntimeError("the SDK read nothing")
        for servo in robot.servos:
            read.getData(servo.id, BLOCK + BLOCK_SIZE - 4, 4)

    return step


def driven(robot: Robot, made: Driver) -> Step:
    """Return a step of our driver: the same two packets, with freshness and counters."""

    def step(goals: np.ndarray) -> None:
        made.read()
        made.command(goals)

    return step


def guarded(robot: Robot, made: Driver) -> Step:
    """Return a step of the guard: limits, checks, and one servo's health."""
    guard = Guard(made)
    guard.arm()

    def step(goals: np.ndarray) -> None:
        guard.read()
        guard.command(goals)

    return step


WAYS: dict[str, Callable[[Robot, Driver], Step]] = {
    "emulator alone": alone,
    "the SDK's bare group calls": bare,
    "driver": driven,
    "driver, guard and one health": guarded,
}


def cost(robot: Robot, way: Callable[[Robot, Driver], Step], steps: int) -> float:
    """Return the processor time of a step [ms]."""
    made = driver(robot)
    step, pace = way(robot, made), FixedRate(made.clock, RATE)
    began = time.process_time()
    for k in range(steps):
        pace.wait()
        step(np.full(len(robot.servos), 0.2 * np.sin(k / 20)))
    spent = time.process_time() - began
    made.torque_off()
    made.close()
    return 1e3 * spent / steps


def compare(counts: Sequence[int], steps: int) -> Table:
    """Return what a step costs in each way, medians of rounds in turns, a row for each robot."""
    table = Table(("servos", *WAYS, "driver / bare"))
    with tempfile.TemporaryDirectory() as folder:
        for count in counts:
            robot = chain(count, Path(folder))
            rounds = [[cost(robot, way, steps) for way in WAYS.values()] for _ in range(ROUNDS)]
            spent = np.median(rounds, axis=0)
            table.add(count, *map(float, spent), float(spent[2] / spent[1]))
    table.notes.append(
        "Processor time of a control step [ms], the emulator's included, at 50 steps a second on "
        f"one thread; medians of {ROUNDS} rounds of {steps} steps, in turns. Made by `python -m "
        "benchmarks.bus`."
    )
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, measure and write; return the exit status."""
    parser = command("bus", __doc__, "results")
    add = parser.add_argument
    add("--servos", type=at_least(1), nargs="+", default=[3, 12], help="how many a robot has")
    add("--steps", type=at_least(1), default=1000, help="of a round")
    chosen = parser.parse_args(arguments)
    table = compare(chosen.servos, chosen.steps)
    table.write(chosen.results / "bus", "What a step over the bus costs")
    sys.stdout.write(table.markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
