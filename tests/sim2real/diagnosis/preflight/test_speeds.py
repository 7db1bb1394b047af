"""A speed's delay and scale are found to a millisecond and a per cent, whichever the joint."""

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.preflight.speeds import check_speeds, speed_law
from tests.sim2real.diagnosis.preflight.stamped import log, motion, silent

HINGE = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint name="hinge"/><geom size=".1"/></body></worldbody></mujoco>'
)


@pytest.mark.parametrize("late", [-0.05, -0.01, 0.03, 0.05])
@pytest.mark.parametrize("scale", [1.0, -57.3])
def test_scale_and_delay_are_found_together(late: float, scale: float) -> None:
    """Counts and a coarse speed register do not hide them; neither depends on the other."""
    made = log(late)
    columns = {**made.columns, "qvel.hinge": scale * made.column("qvel.hinge")}
    law = speed_law([Log(columns)], "hinge")
    assert law is not None
    assert law.delay == pytest.approx(late, abs=1e-3)
    assert law.scale == pytest.approx(scale, rel=0.01)


@pytest.mark.parametrize(
    ("late", "filtered", "check"),
    [(-0.01, 0.0, "clock"), (0.01, 0.0, "velocity_filter"), (0.0, 0.03, "velocity_filter")],
)
def test_a_late_speed_is_a_note_and_an_early_one_another_clock(
    late: float, filtered: float, check: str
) -> None:
    """No filter is ahead of its input; what is behind it may be one."""
    (finding,) = check_speeds([(log(late, filtered=filtered), HINGE)])
    assert (finding.check, finding.where) == (check, "hinge")


@pytest.mark.parametrize("seed", range(5))
def test_one_clock_is_left_alone(seed: int) -> None:
    """Jitter, counts and a constant latency are no finding."""
    assert list(check_speeds([(log(seed=seed), HINGE)])) == []


def test_logs_that_say_nothing() -> None:
    """No finding and no error."""
    assert list(check_speeds([(one, HINGE) for one in silent()])) == []


@pytest.mark.parametrize(("rate", "timestep"), [(50, 0.002), (100, 0.005), (100, 0.01)])
def test_a_simulation_s_own_speeds_are_left_alone(rate: int, timestep: float) -> None:
    """Speeds as the simulator has them, of a stiff servo whose commands change at the rows."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep}" integrator="implicitfast"/><worldbody><body>'
        '<joint name="hinge" armature=".005"/><geom size=".1" pos=".1 0 0" mass=".1"/></body>'
        '</worldbody><actuator><position joint="hinge" kp="20" kv=".5"/></actuator></mujoco>'
    )
    data, time, rows = mujoco.MjData(model), np.arange(0, 20, 1 / rate), []
    command, _ = motion(time)
    for goal in command:
        rows.append((data.qpos[0], data.qvel[0]))
        data.ctrl[:] = goal
        mujoco.mj_step(model, data, round(1 / rate / timestep))
    q, v = np.transpose(rows)
    own = {"ctrl.hinge": command, "qpos.hinge": q, "qvel.hinge": v}
    made = Log({"episode": 0 * time, "time": time, **own})
    assert list(check_speeds([(made, model)])) == []
    filtered = Log({**made.columns, "qvel.hinge": np.interp(time - 0.02, time, v)})
    assert [f.check for f in check_speeds([(filtered, model)])] == ["velocity_filter"]
