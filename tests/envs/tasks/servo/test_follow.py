"""Follow: any arm on its sines, within its limits; the STS3215's constants from its registers."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from envs.errors import TaskError
from envs.simulation import Simulation
from envs.tasks import Follow
from envs.tasks.base import CommandState
from envs.tasks.servo.base import Fidelity
from envs.tasks.servo.robot import ROBOTS

SO101 = "tests/hardware/so101.xml"


def arm(**registers: int) -> dict[str, Any]:
    """Return what the SO-101's file holds, with some registers set otherwise."""
    data = yaml.safe_load((ROBOTS / "so101.yaml").read_text(encoding="utf-8"))
    data["registers"].update(registers)
    return data


def total(fidelity: Fidelity) -> float:
    """Return what following without a lead earns."""
    sim = Simulation(Follow(fidelity, model=SO101), 1, threads=1)
    sim.reset(np.arange(1), sim.space.points(1), np.zeros(1, np.uint64))
    return sum(float(sim.step(None, np.zeros((1, 6))).reward[0]) for _ in range(sim.max_steps))


def test_a_soft_servo_follows_worse() -> None:
    """The SO-101's gain of 16 lags far behind a stiff position actuator."""
    assert total("servo") < 5 * total("ideal") < 0


def test_registers_give_the_models_own_actuators() -> None:
    """Gain, limit and back-EMF are those that the MJCF states; a torque limit lowers the limit."""
    own = mujoco.MjModel.from_xml_path(SO101)
    model = Follow("servo", model=SO101).spec().compile()
    for name in ("biasprm", "gainprm", "forcerange", "damping"):
        field = f"actuator_{name}"
        np.testing.assert_allclose(getattr(model, field), getattr(own, field), rtol=2e-4)
    weak = Follow("servo", arm(torque_limit=485), SO101).spec().compile()
    np.testing.assert_allclose(weak.actuator_forcerange, model.actuator_forcerange / 2, rtol=1e-9)
    with pytest.raises(TaskError, match="position_d_gain=32 of a sts3215 is not simulated"):
        Follow("servo", arm(position_d_gain=32), SO101)


@pytest.mark.parametrize(("robot", "model"), [("so101", SO101), ("arm2", "arm2.xml")])
def test_references_begin_at_rest_and_stay_within_the_limits(robot: str, model: str) -> None:
    """At the start each joint is where it shall be; a sine takes half of its range."""
    task = Follow(robot=robot, model=model)
    assert task.reference(np.zeros(1))[0] == pytest.approx(task.start[task.q])
    path = task.reference(np.linspace(0, 30, 3000))
    assert (path >= task.machine.low).all() and (path <= task.machine.high).all()
    later = task.reference(np.linspace(2, 30, 3000))
    spread = np.ptp(later, axis=0) / (task.machine.high - task.machine.low)
    assert spread == pytest.approx(0.5, abs=0.01)
    assert len(
        task.observe(task.state_from_measurement(task.start[None, task.q], *blank(task)))[0]
    ) == 4 * len(spread)


def blank(task: Follow) -> tuple[np.ndarray, Any]:
    """Return speeds of 0 and a command that was never given."""
    rest = task.start[None, task.q]
    return 0 * rest, CommandState(np.zeros(1), 0 * rest, rest)


def test_a_model_has_to_be_given() -> None:
    """The SO-101's is not part of the project; the message says how to give it."""
    with pytest.raises(TaskError, match=r"give env\.task\.model=PATH"):
        Follow()


KOCH = """<mujoco><option gravity="0 0 0"/>
  <custom><numeric name="torque_rate.lift" data="31.4"/></custom>
  <worldbody><body><joint name="lift" axis="0 1 0" range="-1.5 1.5"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.05"/></body></worldbody>
  <actuator><position name="lift" joint="lift" kp="5" forcerange="-0.5 0.5"/></actuator>
</mujoco>"""


def test_the_file_says_how_fast_a_torque_changes_whatever_the_model_states(tmp_path: Path) -> None:
    """An XL330 limits it as delivered, an ideal servo never; a nominal model's number is not added.

    As delivered: 140 steps of 1.977 V/s, times K / R.
    """
    model = tmp_path / "nominal.xml"
    model.write_text(KOCH)
    data = yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8"))
    data["servos"] = {"lift": data["servos"].pop("hinge")}
    for register, rate in ((None, 140), (70, 70), (255, None)):
        data["registers"].pop("pwm_slope", None)
        data["registers"] |= {} if register is None else {"pwm_slope": register}
        slopes = slopes_of(Follow("servo", data, str(model)))
        expected = [] if rate is None else [pytest.approx(rate * 1.977 * 0.386 / 3.40)]
        assert slopes == expected
        assert slopes_of(Follow("ideal", data, str(model))) == []


def slopes_of(task: Follow) -> list[float]:
    """Return the rates [N·m/s] that a simulation of the task's robot keeps to."""
    sim = Simulation(task, 1, threads=1)
    rates = [getattr(rule, "steps", ()) for rule in sim.plant.substep_rules]  # N·m a step
    return [float(rate) / sim.plant.model.opt.timestep for own in rates for rate in own]
