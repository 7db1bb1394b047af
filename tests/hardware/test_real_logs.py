"""The emulated XL330 against the real one: the published logs, replayed in three models.

Run with `-s` and SIM2REAL_DATA set to see the table of benchmarks/notebook/servos.md.
"""

import os
import struct
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware import parts
from hardware.config import load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.log import Log, read_logs
from hardware.tables import servo_type

REAL = os.environ.get("SIM2REAL_DATA")
STEP = 2 * np.pi / 4096
FRICTION = [  # as Rhoban/bam identified it: models m1 (first two) and m4 (the others)
    {"effect": "coulomb_friction", "value": 0.0128},
    {"effect": "viscous_friction", "value": 0.0037},
    {"effect": "load_dependent_friction", "value": 0.068},
    {"effect": "stribeck_friction", "value": 0.074, "extra": {"speed": 2.56}},
]


def ideal(log: Log) -> np.ndarray:
    """Replay a log in the `position` actuator of the model beside it."""
    model = mujoco.MjModel.from_xml_path(str(log.model))
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = log.column("qpos.hinge")[0], log.column("qvel.hinge")[0]
    ctrl, torque = log.column("ctrl.hinge"), log.column("torque.hinge")
    model.opt.disableactuator = 0
    times, track = [], []
    while data.time < log.time[-1] + 2e-3:
        row = max(int(np.searchsorted(log.time, data.time + 1e-9, "right")) - 1, 0)
        model.opt.disableactuator = 0 if torque[row] else 1
        data.ctrl[0] = ctrl[row]
        times.append(data.time)
        track.append(data.qpos[0])
        mujoco.mj_step(model, data)
    return np.interp(log.time, times, track)


def emulated(log: Log, effects: list) -> np.ndarray:
    """Replay a log in the emulated servo, with the voltage that the real one measured."""
    robot = load_robot("bench1_bam")
    robot = replace(robot, registers=dict(robot.registers) | log.settings["hinge"])
    world = EmulatedRobot(robot, make_hidden(effects, robot))
    servo, data = world.servos[0], world.mechanics.data
    gain = servo.memory.kind.registers["position_p_gain"]
    servo.write(gain.address, gain.encode(log.settings["hinge"]["position_p_gain"]), 0.0)
    world.servos[0].memory["operating_mode"] = 4
    data.qpos[0], data.qvel[0] = log.column("qpos.hinge")[0], log.column("qvel.hinge")[0]
    columns = ("ctrl.hinge", "torque.hinge", "voltage.hinge")
    track, on = [], 0.0
    for time, goal, torque, volts in zip(log.time, *map(log.column, columns), strict=True):
        world.advance(time)
        track.append(float(world.mechanics.angle[0]))
        world.firmware.battery[:] = volts
        if torque != on:
            servo.write(64, bytes([int(torque)]), time)
            on = torque
        servo.write(116, struct.pack("<i", 2048 + round(goal / STEP)), time)
    return np.array(track)


@pytest.mark.skipif(not REAL, reason="SIM2REAL_DATA does not name the folder of real logs")
@pytest.mark.slow
@pytest.mark.parametrize("gain", [100, 200, 800])
def test_published_constants_are_nearer_to_the_real_servo(monkeypatch, gain):
    """The servo with published constants replays the real logs better than the nominal models."""
    logs = read_logs(Path(str(REAL)) / "xl330_bench")
    chosen = [log for log in logs if f"p{gain}_" in str(log.path)]
    usual = servo_type("xl330-m288")
    sheet = replace(usual, torque_constant=0.405, gain_divisor=128)
    rows = {}
    for name in ("ideal", "servo, data sheet", "servo, published"):
        kind = sheet if "sheet" in name else usual
        monkeypatch.setattr(parts, "servo_type", lambda _, kind=kind: kind)
        errors = []
        for log in chosen:
            effects = FRICTION if "published" in name else []
            track = ideal(log) if name == "ideal" else emulated(log, effects)
            errors.append(float(np.abs(track - log.column("qpos.hinge")).mean()))
        rows[name] = errors
    names = [Path(str(log.path)).stem for log in chosen]
    sys.stdout.write(f"\nmean absolute error [mrad] of {names}\n")
    for name, errors in rows.items():
        each = " ".join(f"{1e3 * error:6.0f}" for error in errors)
        sys.stdout.write(f"{name:>20} {each}   mean {1e3 * np.mean(errors):.0f}\n")
    assert np.mean(rows["servo, published"]) < 0.7 * np.mean(rows["servo, data sheet"])
    assert np.mean(rows["servo, published"]) < 0.7 * np.mean(rows["ideal"])
