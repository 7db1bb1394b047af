import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import EffectError
from envs.plant import Plant

MOTOR = '<motor name="servo" joint="hinge" forcerange="-2 2"/>'
FAST = (
    '<position name="servo" joint="hinge" kp="50" ctrlrange="-500 500" forcerange="-2 2"'
    ' damping="0.2"/>'
)
TORQUE = 0.2 * 9.81 * 0.1  # of gravity on the level link [N·m]


def sag(arm) -> np.ndarray:
    """Return how far the level link hangs below its goal, (n,)."""
    arm.reset()
    return arm.hold(0.0, 5.0)


def test_position_gain_divides_the_sag(bench, one) -> None:
    """A servo of gain c kp settles where c kp times the error carries gravity."""
    end = sag(bench([one("position_gain")], [[0.5], [1.0], [2.0]], gravity=9.81))
    gains = np.array([0.5, 1.0, 2.0])
    assert 4.0 * gains * end == pytest.approx(TORQUE * np.cos(end), rel=1e-6)


def test_derivative_gain_is_the_damping_of_the_loop(bench, one) -> None:
    """An undamped loop goes on ringing, a damped one is at rest."""
    arm = bench([one("derivative_gain")], [[0.0], [1.0]])
    arm.reset(0.2)
    ends = arm.run(np.zeros(300), 4)[0]
    assert np.abs(ends[-80:, 0]).max() > 0.15
    assert np.abs(ends[-80:, 1]).max() < 1e-3


@pytest.mark.parametrize("actuator", ["servo", "motor"])
def test_motor_strength_is_a_factor_on_torque(bench, one, actuator: str) -> None:
    """The same command yields the factor times the torque, and saturates at the scaled limit."""
    factors = np.array([0.5, 1.0, 1.5])
    law = {"motor": MOTOR}.get(actuator)
    arm = bench([one("motor_strength")], factors[:, None], **({"actuator": law} if law else {}))
    for command, nominal in ((0.1, 0.4 if law is None else 0.1), (2.5, 2.0)):
        arm.reset()
        arm.run(command, 1)
        assert arm.force == pytest.approx(factors * nominal, rel=1e-9)


def test_motor_strength_keeps_the_no_load_speed_and_supply_voltage_scales_it(bench, one) -> None:
    """Back-EMF is the motor's own torque: strength scales it, the supply does not."""
    for name, speeds in (("motor_strength", [10.0, 10.0]), ("supply_voltage", [7.0, 10.0])):
        arm = bench([one(name)], [[0.7], [1.0]], FAST)
        arm.reset()
        arm.run(400.0, 2000)
        assert arm.speed == pytest.approx(speeds, rel=1e-3)


def test_a_motor_whose_braking_is_kept_is_one_with_less_voltage(bench, one) -> None:
    """Its path is that of the supply of a single servo, and its no-load speed falls with it."""
    ways = one("motor_strength", braking="kept"), one("supply_voltage")
    arms = [bench([way], [[0.7], [1.0]], FAST) for way in ways]
    for arm in arms:
        arm.reset()
        arm.run(400.0, 2000)
    assert arms[0].speed == pytest.approx([7.0, 10.0], rel=1e-3)
    np.testing.assert_array_equal(arms[0].speed, arms[1].speed)
    np.testing.assert_array_equal(arms[0].force, arms[1].force)
    both = bench([one("motor_strength"), one("motor_strength", braking="kept")], [[0.5, 0.5]])
    both.reset()
    both.run(0.1, 1)
    assert both.force[0] == pytest.approx(0.25 * 0.4)  # they multiply, side by side in one batch
    with pytest.raises(EffectError, match=r"braking='keep' is unknown .did you mean 'kept'"):
        one("motor_strength", braking="keep")


def test_supply_voltage_scales_the_law_of_servos_and_only_the_limit_of_motors(bench, one) -> None:
    """A voltage-driven loop loses gain with its supply; a current-driven one does not."""
    for drive, expected in ((None, 0.2), ("voltage", 0.2), ("current", 0.4)):
        arm = bench([one("supply_voltage", drive=drive)], [[0.5]])
        arm.reset()
        arm.run(0.1, 1)
        assert arm.force[0] == pytest.approx(expected)
    arm = bench([one("supply_voltage")], [[0.5]], MOTOR)
    for command, expected in ((0.4, 0.4), (5.0, 1.0)):
        arm.reset()
        arm.run(command, 1)
        assert arm.force[0] == pytest.approx(expected)


def test_torque_limit_gives_a_limit_to_an_actuator_without_one(bench, one) -> None:
    """The limit holds at the joint, behind the gear; absent, nothing is limited."""
    free = '<motor name="servo" joint="hinge" gear="10"/>'
    arm = bench([one("torque_limit")], [[0.5], [1e6]], free)
    arm.reset()
    arm.run(3.0, 1)
    assert arm.torque == pytest.approx([0.5, 30.0])
    off = '<motor name="servo" joint="hinge" forcelimited="false" forcerange="-1 1"/>'
    arm = bench([one("torque_limit")], [[0.5], [1e6]], off)  # the model has a range and no limit
    arm.reset()
    arm.run(3.0, 1)
    assert arm.torque == pytest.approx([0.5, 3.0])


def test_torque_limit_is_absent_at_the_models_own(bench, one) -> None:
    """The neutral value is the model's limit, and a factor scales it."""
    arm = bench([one("torque_limit")])
    assert arm.plant.space.neutral == [2.0]
    scaled = bench([one("torque_limit", how="scale")], [[0.25]])
    scaled.reset()
    scaled.run(3.0, 1)
    assert scaled.force[0] == pytest.approx(0.5)


@pytest.mark.parametrize("delay", [0.0, 0.007])
def test_dead_zone_has_its_width(bench, one, delay: float) -> None:
    """A goal within the zone moves nothing, one beyond it does; also behind a delay line."""
    zone = 0.02
    effects = [one("dead_zone")]
    if delay:
        effects.append(make("command_delay"))
    values = [[zone] + [delay] * bool(delay)] * 2
    for error, moves in ((0.9 * zone, False), (-0.9 * zone, False), (1.1 * zone, True)):
        arm = bench(effects, values)
        arm.reset(ctrl=np.zeros((2, 1)))
        assert (abs(arm.hold(error, 0.5)) > 1e-6).all() == moves


def test_dead_zone_is_left_at_full_torque(bench, one) -> None:
    """Beyond the zone the law is whole: the servo overshoots no wider zone than its own."""
    arm = bench([one("dead_zone")], [[0.02]])
    arm.reset()
    arm.run(0.1, 1)
    assert arm.force[0] == pytest.approx(0.4)


@pytest.mark.parametrize("punch", [0.0, 0.25, 1.0])
@pytest.mark.parametrize("error", [0.1, -0.1])
def test_beyond_a_dead_zone_its_punch_says_how_much_of_the_law_is_there(
    bench, one, punch: float, error: float
) -> None:
    """From the edge on: kp (e - (1 - punch) d), in both directions, free or given."""
    width, kp = 0.02, 4.0
    for arm in (
        bench([one("dead_zone", free=("punch",))], [[width, punch]]),
        bench([one("dead_zone", punch=punch)], [[width]]),
    ):
        arm.reset()
        arm.run(error, 1)
        law = kp * (abs(error) - (1 - punch) * width)
        assert arm.force[0] == pytest.approx(np.sign(error) * law)


def test_supply_sag_lowers_the_torque_by_the_current(bench, one) -> None:
    """A long push ends where tau = tau0 (1 - R tau / (kt V))."""
    arm = bench([one("supply_sag", voltage=5.0, torque_constant=0.4)], [[0.0], [1.0]], MOTOR)
    arm.reset()
    arm.run(1.0, 60)
    loaded = 1 / (1 + 1.0 / (0.4 * 5.0))
    assert arm.force == pytest.approx([1.0, loaded], rel=1e-6)


def test_supply_sag_needs_to_know_the_supply(one) -> None:
    """Without the supply's voltage the value would mean nothing."""
    with pytest.raises(EffectError, match="needs voltage"):
        one("supply_sag", torque_constant=0.4)


def test_thermal_derating_follows_the_integral_of_torque_squared(bench, one) -> None:
    """The factor is 1 - value E, with E the integral of torque²; a pause with decay restores it."""
    stopped = '<motor name="servo" joint="hinge"/>'
    loss = 0.05
    arm = bench([one("thermal_derating", decay=2.0)], [[loss]], stopped, damping=1e3)
    arm.reset()
    arm.run(1.0, 3000)
    t, heat = 0.0, 0.0
    for _ in range(3000):
        heat = heat * np.exp(-2.0 * 1e-3) + (max(1 - loss * heat, 0.0) ** 2) * 1e-3
        t += 1e-3
    assert arm.force[0] == pytest.approx(1 - loss * heat, rel=1e-3)
    arm.run(0.0, 4000)
    arm.run(1.0, 1)
    assert arm.force[0] == pytest.approx(1.0, abs=1e-3)


def test_thermal_derating_weakens_the_back_emf_too(bench, one) -> None:
    """A hot winding brakes less: what a motor does is all scaled by the same factor."""
    servo = '<position name="servo" joint="hinge" kp="0.1" damping="0.2"/>'
    hot = bench([one("thermal_derating")], [[0.0], [0.02]], servo, damping=0.0)
    weak = bench([one("motor_strength")], [[1.0], [1.0]], servo, damping=0.0)
    hot.reset(w=20.0)
    hot.plant.substep_rules[0].heat[:] = [[0.0], [30.0]]  # a factor of 0.4
    weak.plant.set_params(np.arange(2), np.array([[1.0], [0.4]]))
    weak.reset(w=20.0)
    for arm in (hot, weak):
        arm.run(0.0, 5)
    assert hot.speed == pytest.approx(weak.speed, rel=2e-3)
    assert hot.speed[1] > 1.05 * hot.speed[0]


def test_heat_may_spare_the_back_emf(bench, one) -> None:
    """With braking 1 the torque weakens alone: a free joint spins down as if it were cold."""
    servo = '<position name="servo" joint="hinge" kp="1e-6" damping="0.2"/>'
    effects = [one("thermal_derating", free=("braking",))]
    arm = bench(effects, [[0.0, 0.0], [0.02, 0.0], [0.02, 0.5], [0.02, 1.0]], servo, damping=0.0)
    arm.reset(w=20.0)
    arm.plant.substep_rules[0].heat[:] = [[0.0], [30.0], [30.0], [30.0]]  # a factor of 0.4
    arm.run(0.0, 5)
    lost = np.log(20.0 / arm.speed)
    assert lost / lost[0] == pytest.approx([1.0, 0.4, 0.7, 1.0], rel=0.03)


def test_damping_that_is_spared_makes_no_heat(bench, one) -> None:
    """A joint that is driven round: with braking 1 nothing flows but what the servo asks for."""
    servo = '<position name="servo" joint="hinge" kp="1e-6" damping="0.2"/>'
    arm = bench(
        [one("thermal_derating", free=("braking",))], [[1e-9, 0.0], [1e-9, 1.0]], servo, damping=0.0
    )
    arm.reset(w=20.0)
    arm.run(0.0, 5)
    heat = arm.plant.substep_rules[0].heat[:, 0]
    assert heat[0] > 1e-3 and heat[1] < 1e-6 * heat[0]


@pytest.mark.parametrize("name", ["position_gain", "derivative_gain", "dead_zone"])
def test_a_torque_motor_is_refused_with_what_it_can_have(bench, one, name: str) -> None:
    """The error lists the effects that the actuator does have."""
    with pytest.raises(EffectError, match=r"cannot have.*motor_strength.*torque_limit"):
        bench([one(name)], actuator=MOTOR)


def test_one_value_for_every_actuator_that_can(bench) -> None:
    """Without a place the factor acts on all of them; without any, the list is given."""
    bench([make("position_gain")], [[0.5]])
    with pytest.raises(EffectError, match="no actuator of this model can have position_gain"):
        bench([make("position_gain")], actuator=MOTOR)


def test_a_pid_servo_has_gains_too() -> None:
    """The engine's PID actuator is scaled through its proportional gain."""
    text = """<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1"/></body>
    </worldbody><actuator><pid name="p" joint="j" kp="2"/></actuator></mujoco>"""
    plant = Plant(mujoco.MjSpec.from_string(text), [make("position_gain", where="p")], 2, 1)
    plant.set_params(np.arange(2), np.array([[1.0], [2.0]]))
    force, q = plant.batch.bind("actuator_force"), np.full((2, 1), -0.3)
    plant.reset(np.arange(2), q, np.zeros((2, 1)), np.zeros(2, np.uint64))
    assert force[:, 0] == pytest.approx([0.6, 1.2])
