"""Drive a robot along given angles and write down what it did, as a trajectory log.

    with Guard(driver) as guard:
        guard.arm()
        log = record(guard, excite(robot, pose, 10.0, ("ramp", "swing"), rng))
    write_log("swing.csv", log)

The guard's limits and stops hold while it is driven.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from hardware.config import Robot
from hardware.excite import Plan
from hardware.log import Log
from hardware.pace import Pace
from hardware.safety import Guard


def joint_names(robot: Robot) -> list[str]:
    """Return the joint that each servo turns, in the order of the robot's file."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    joints = [model.actuator(name).trnid[0] for name in robot.names]
    return [model.joint(int(joint)).name for joint in joints]


def record(guard: Guard, plan: Plan | np.ndarray, episode: int = 0) -> Log:
    """Command a plan, one row a control step, and return the log of one episode.

    Torque goes off and on at the time of the row that says so; switching can cost a step or two.
    While it is off, `ctrl` is where the joints are.

    Args:
        guard: armed servos.
        plan: wanted angles [rad], (T, n), and where torque is on; what was sent after every limit
            is `ctrl`.
        episode: its number.

    Returns:
        A log with ctrl, qpos, qvel, current, stamp and torque of every servo, voltage and
        temperature as last told (one servo a step tells them), the wanted angles as `action`, the
        duty as `sensor.duty_<servo>`, the raw position as `sensor.count_<servo>`, and `flag.fresh`
        (0: an answer was missing, the last value is held).

    Raises:
        SafetyError: the robot was stopped on the way.
    """
    robot, clock = guard.driver.robot, guard.driver.clock
    if not isinstance(plan, Plan):
        plan = Plan(np.asarray(plan, float), np.ones(len(plan), bool))
    pace, rows, start, on = Pace(clock, robot.rate), [], None, True
    for wanted, torque in zip(plan.angles, plan.torque.tolist(), strict=True):
        pace.wait()
        reading = guard.read()
        now = clock.now()
        start = now if start is None else start
        if torque != on:
            guard.stiffen() if torque else guard.limp()
            on = torque
        sent = guard.command(wanted).angles if on else reading.position
        state = list(guard.health)
        rows.append((now - start, wanted, sent, reading, on and not guard.dry_run, state))
    time, action, ctrl, readings, driven, states = zip(*rows, strict=True)
    columns: dict[str, Any] = {"episode": np.full(len(rows), episode), "time": np.array(time)}
    pairs = list(zip(robot.names, joint_names(robot), strict=True))
    for i, (name, _) in enumerate(pairs):
        columns[f"ctrl.{name}"] = np.array([row[i] for row in ctrl])
    for kind, field in (("qpos", "position"), ("qvel", "velocity")):
        for i, (_, joint) in enumerate(pairs):
            columns[f"{kind}.{joint}"] = np.array([getattr(r, field)[i] for r in readings])
    for i, (name, joint) in enumerate(pairs):
        columns[f"stamp.{joint}"] = np.array([r.stamp[i] - start for r in readings])
        columns[f"current.{name}"] = np.array([r.current[i] for r in readings])
        told = [state[i] for state in states if state[i] is not None]
        if len(told) == len(rows):
            columns[f"voltage.{name}"] = np.array([health.voltage for health in told])
            columns[f"temperature.{name}"] = np.array([health.temperature for health in told])
        columns[f"torque.{name}"] = np.array(driven, float)
        columns[f"sensor.duty_{name}"] = np.array([r.duty[i] for r in readings])
        columns[f"sensor.count_{name}"] = np.array([r.count[i] for r in readings])
        columns[f"action.{name}"] = np.array([row[i] for row in action])
    columns["flag.fresh"] = np.array([float(r.fresh.all()) for r in readings])
    settings = {servo.name: robot.registers_of(servo) for servo in robot.servos}
    meta = {"robot": robot.name, "model": str(robot.model.resolve()), "settings": settings}
    meta |= {"rate": robot.rate, "command_delay": robot.command_delay}
    meta["supply_voltage"] = robot.supply.voltage
    return Log(columns, meta)
