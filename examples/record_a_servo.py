"""Drive a servo along a sine and write its log; without a port an emulated one answers.

python examples/record_a_servo.py swing.csv [/dev/ttyUSB0]
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from hardware.config import load_robot
from hardware.connect import make_driver
from hardware.log import write_log
from hardware.record import record
from hardware.safety import Guard

SECONDS, HERTZ, SIZE = 4.0, 0.5, 0.3  # s, 1/s, rad


def main(path: str, port: str | None = None) -> None:
    """Record one servo of `bench1`."""
    robot = load_robot("bench1")
    driver = make_driver(robot if port is None else replace(robot, port=port))
    driver.connect()  # checks everything, writes nothing
    driver.configure()  # torque off, registers written and read back
    time = np.arange(0.0, SECONDS, 1 / robot.rate)
    angles = SIZE * np.sin(2 * np.pi * HERTZ * time)[:, None]  # (T, 1)
    with Guard(driver) as guard:  # torque off at the end, whatever happens
        guard.arm()
        log = record(guard, angles)
    driver.close()
    print(write_log(path, log))


if __name__ == "__main__":
    main(*sys.argv[1:])
