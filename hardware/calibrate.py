"""A calibration of a robot whose joints a person moves: the verb calibrate."""

from pathlib import Path

from hardware.by_hand import HandMeasurement
from hardware.calibration import Calibration, Joint, apply_calibration, write_calibration
from hardware.connect import patient
from hardware.driver import Driver
from hardware.files import check_new
from hardware.terminal import Ask, Tell


def calibrate(driver: Driver, path: Path, ask: Ask, tell: Tell) -> None:
    """Switch torque off, take every joint's range and zero by hand, and write the file.

    Raises:
        UsageError: nobody answers, or it was interrupted; nothing was written.
        RobotError: the file is there already or cannot be made; what was shown has nothing in
            common with the robot's limits, or crosses an encoder's seam.
        HardwareError: see `Driver.connect`.
    """
    check_new(path)
    robot, joints = driver.robot, {}
    driver.connect()
    driver.torque_off()
    hand = HandMeasurement(driver, ask)
    for i, servo in enumerate(robot.servos):
        with patient(driver):
            travel = hand.measure(i)
        ends = sorted(servo.count(angle) for angle in (travel.low, travel.high))
        joints[servo.name] = Joint(
            id=servo.id,
            drive_mode=0,
            homing_offset=0,
            range_min=ends[0],
            range_max=ends[1],
            model=servo.model,
            zero=servo.count(travel.zero),
            sign=servo.sign * travel.sign,
        )
    calibration = Calibration(joints, robot.name)
    apply_calibration(robot, calibration)
    write_calibration(path, calibration)
    tell(f"wrote {path}")
