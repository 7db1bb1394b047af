"""A robot whose motors are all weak, simulated by MuJoCo alone: one cause, not one a joint."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.diagnose import diagnose

JOINTS = ("shoulder", "elbow", "wrist")
GAINS, DAMPING, LIMITS = (60.0, 35.0, 15.0), (2.0, 1.2, 0.4), (12.0, 7.0, 3.0)
LENGTHS, MASSES = (0.25, 0.2, 0.12), (0.9, 0.5, 0.2)
RATE, COUNT = 100, 2 * np.pi / 4096


def arm(strength: float, timestep: float) -> str:
    """Return an arm of three links whose servos have so much of their torque."""
    bodies = "".join(
        f'<body name="{name}_link" pos="{at} 0 0"><joint name="{name}" axis="0 1 0" '
        f'armature="0.01" damping="0.03" frictionloss="0.02"/><geom type="capsule" size="0.02" '
        f'fromto="0 0 0 {length} 0 0" mass="{mass}" contype="0" conaffinity="0"/>'
        for name, at, length, mass in zip(JOINTS, (0.0, *LENGTHS[:2]), LENGTHS, MASSES, strict=True)
    )
    servos = "".join(
        f'<position name="{name}" joint="{name}" kp="{strength * kp}" kv="{strength * kv}" '
        f'forcerange="{-strength * limit} {strength * limit}"/>'
        for name, kp, kv, limit in zip(JOINTS, GAINS, DAMPING, LIMITS, strict=True)
    )
    return (
        f'<mujoco><option timestep="{timestep}" integrator="implicitfast"/><worldbody>{bodies}'
        f"{'</body>' * len(JOINTS)}</worldbody><actuator>{servos}</actuator></mujoco>"
    )


def log_of(strength: float, seconds: float) -> Log:
    """Return steps, sweeps and holds of such an arm at 100 Hz, in encoder counts."""
    model, rng = mujoco.MjModel.from_xml_string(arm(strength, 5e-4)), np.random.default_rng(2)
    data, rows = mujoco.MjData(model), round(RATE * seconds)
    time = np.arange(rows) / RATE
    goals, seen = np.zeros((rows, 3)), np.zeros((rows, 3))
    for i in range(3):
        steps, holds = (np.repeat(rng.uniform(-0.8, 0.8, rows), n)[:rows] for n in (70, 200))
        sweep = 0.5 * np.sin(2 * np.pi * (0.3 + 0.15 * i + 0.04 * (time % 12)) * time)
        goals[:, i] = np.choose((time // 4).astype(int) % 3, [steps, sweep, holds])
    for row, goal in enumerate(goals):
        seen[row] = np.round((data.qpos + 2e-4 * rng.normal(size=3)) / COUNT) * COUNT
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, 20)
    columns = {"episode": np.zeros(rows, int), "time": time}
    columns |= {f"ctrl.{name}": goals[:, i] for i, name in enumerate(JOINTS)}
    columns |= {f"qpos.{name}": seen[:, i] for i, name in enumerate(JOINTS)}
    return Log(columns)


@pytest.mark.slow
def test_weak_motors_are_one_cause(tmp_path: Path) -> None:
    """All motors at 0.73: one strength for the robot, which its supply may be as well."""
    path = tmp_path / "arm.xml"
    path.write_text(arm(1.0, 2e-3), encoding="utf-8")
    report = diagnose([log_of(0.73, 16.0)], path)
    assert report.evidence.inputs["physics steps"] > 0
    (cause,) = report.causes
    assert report.verdict == "explained"
    assert cause.where is None and cause.shared == (cause.effect == "motor_strength")
    weak = {"motor_strength", "supply_voltage"}
    assert cause.effect in weak
    assert weak - {cause.effect} == {e.effect for e in cause.equivalent if e.inseparable}
    assert cause.value_ci[0] <= 0.73 <= cause.value_ci[1]
    assert cause.value == pytest.approx(0.73, rel=0.02)
