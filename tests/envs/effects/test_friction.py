import numpy as np
import pytest

INERTIA = 0.001 + 1e-4 + 0.2 * 0.1**2  # of the bench's rotor and link about the hinge [kg·m²]
MOTOR = '<motor name="servo" joint="hinge"/>'


def test_coulomb_friction_stops_a_free_swing_in_the_time_of_its_torque(bench, one) -> None:
    """Speed falls linearly, and the joint stops after I w / tau."""
    torques = [0.01, 0.02]
    arm = bench([one("coulomb_friction")], [[t] for t in torques], MOTOR)
    arm.reset(w=2.0)
    speeds = []
    for _ in range(1000):
        arm.run(0.0)
        speeds.append(arm.speed.copy())
    stopped = (np.abs(speeds) > 1e-3).sum(0) * 1e-3
    assert stopped == pytest.approx([INERTIA * 2.0 / t for t in torques], abs=3e-3)


def test_coulomb_friction_sticks_without_creep(bench, one) -> None:
    """Three quarters of the friction's torque move the joint by less than a milliradian in 10 s."""
    arm = bench([one("coulomb_friction")], [[0.4]], MOTOR)
    arm.reset()
    assert abs(arm.hold(0.3, 10.0)[0]) < 1e-3


def test_a_model_with_friction_keeps_its_own_way(bench, one) -> None:
    """Where the model has friction, the neutral effect changes no bit of the motion."""
    plain = '<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" frictionloss="0.02"/>'
    plain += '<geom size="0.1"/></body></worldbody></mujoco>'
    import mujoco

    from envs.plant import Plant

    paths = []
    for effects in ([], [one("coulomb_friction")]):
        plant = Plant(mujoco.MjSpec.from_string(plain), effects, 1, 1)
        plant.reset(np.arange(1), np.zeros((1, 1)), np.ones((1, 1)), np.zeros(1, np.uint64))
        plant.step(None, np.zeros((1, 0)), 50)
        paths.append(plant.qpos.copy())
    assert paths[0] == paths[1]


@pytest.mark.parametrize(
    "name, value",
    [("coulomb_friction", 0.2), ("stribeck_friction", 0.2), ("load_dependent_friction", 0.5)],
)
def test_more_friction_sticks_where_the_models_own_creeps(name: str, value: float, one) -> None:
    """The engine's default friction gives way slowly; with an effect on top it holds."""
    text = '<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" frictionloss="0.4"/>'
    text += '<geom size="0.05" mass="0.2" pos="0.1 0 0"/></body></worldbody></mujoco>'
    import mujoco

    from envs.plant import Plant

    plant = Plant(mujoco.MjSpec.from_string(text), [one(name)], 2, 1)
    plant.set_params(np.arange(2), np.array([[0.0], [value]]))
    plant.reset(np.arange(2), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(2, np.uint64))
    plant.step(None, np.zeros((2, 0)), 2000)
    crept, held = np.abs(plant.qpos[:, 0])
    assert crept > 0.01 > 20 * held
    plant.set_params(np.arange(2), np.array([[value], [0.0]]))  # rows change places
    plant.reset(np.arange(2), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(2, np.uint64))
    plant.step(None, np.zeros((2, 0)), 2000)
    assert np.abs(plant.qpos[:, 0]) == pytest.approx([held, crept])


def test_viscous_friction_is_a_rate_of_decay(bench, one) -> None:
    """Speed decays as exp(-c t / I)."""
    arm = bench([one("viscous_friction")], [[0.005], [0.01]], MOTOR)
    arm.reset(w=1.0)
    arm.run(0.0, 200)
    assert arm.speed == pytest.approx(np.exp(-np.array([0.005, 0.01]) * 0.2 / INERTIA), rel=3e-3)


def test_armature_slows_a_start(bench, one) -> None:
    """A torque accelerates the link in proportion to 1 / (I + value)."""
    arm = bench([one("armature")], [[0.0], [0.01]], MOTOR)
    arm.reset()
    arm.run(0.1, 100)
    assert arm.speed == pytest.approx(0.1 * 0.1 / (INERTIA + np.array([0.0, 0.01])), rel=1e-6)


def test_stribeck_excess_fades_with_speed(bench, one) -> None:
    """At standstill the whole excess holds; far above its speed only the rest brakes."""
    arm = bench([one("stribeck_friction", speed=0.1)], [[0.1]], MOTOR)
    arm.reset()
    assert abs(arm.hold(0.09, 0.5)[0]) < 1e-4
    arm.reset(w=3.0)
    arm.run(0.0, 100)
    assert arm.speed[0] == pytest.approx(3.0, rel=1e-3)
    arm.reset(w=0.1)
    arm.run(0.0, 1)
    slowed = 0.1 - 0.1 * np.exp(-1.0) * 1e-3 / INERTIA
    assert arm.speed[0] == pytest.approx(slowed, rel=2e-2)


def test_free_extras_are_parameters(bench, one) -> None:
    """The Stribeck speed can be drawn or fitted: it is then one more column."""
    arm = bench([one("stribeck_friction", free=("speed",))], [[0.1, 0.1], [0.1, 1e3]], MOTOR)
    assert arm.plant.space.names == ("stribeck_friction.hinge", "stribeck_friction.hinge.speed")
    arm.reset(w=3.0)
    arm.run(0.0, 20)
    assert arm.speed[0] == pytest.approx(3.0, rel=1e-3)
    assert arm.speed[1] == pytest.approx(3.0 - 0.1 * 0.02 / INERTIA, rel=1e-2)


def hysteresis(arm) -> float:
    """Return how far apart the level holds end that slow ramps from both sides lead to."""
    ends = []
    for side in (-0.2, 0.2):
        arm.reset(side)
        arm.run(np.linspace(side, 0.0, 8000))
        ends.append(arm.hold(0.0, 0.5)[0])
    return abs(ends[1] - ends[0])


@pytest.mark.slow
def test_load_dependent_friction_grows_with_the_load(bench, one) -> None:
    """A hold sticks where |tau_m - T| <= K |tau_m + T|: from T (1-K)/(1+K) to T (1+K)/(1-K)."""
    coefficient, gain, load = 0.2, 4.0, 0.2 * 9.81 * 0.1
    arm = bench([one("load_dependent_friction")], [[coefficient]], gravity=9.81)
    ratio = (1 + coefficient) / (1 - coefficient)
    assert hysteresis(arm) == pytest.approx(load * (ratio - 1 / ratio) / gain, rel=0.05)
    assert hysteresis(bench([one("load_dependent_friction")], [[0.0]], gravity=9.81)) < 1e-4
    assert hysteresis(bench([one("load_dependent_friction")], [[0.2]], gravity=0.0)) < 1e-3


def test_load_dependent_friction_may_follow_the_motor_alone(bench, one) -> None:
    """Without the external torque's part a hold sticks from T / (1+K) to T / (1-K)."""
    coefficient, gain, load = 0.2, 4.0, 0.2 * 9.81 * 0.1
    arm = bench([one("load_dependent_friction", external=0.0)], [[coefficient]], gravity=9.81)
    width = 1 / (1 - coefficient) - 1 / (1 + coefficient)
    assert hysteresis(arm) == pytest.approx(load * width / gain, rel=0.05)


def test_back_emf_loads_no_gear(bench, one) -> None:
    """What the motor's own back-EMF takes is no load: a steady motion without any is not rubbed."""
    servo = '<position name="servo" joint="hinge" kp="4" damping="0.3"/>'
    arm = bench([one("load_dependent_friction", external=0.0)], [[0.0], [0.3]], servo)
    arm.reset()
    angles = arm.run(np.linspace(0.0, 2.0, 2000))[0][-1]
    assert angles[0] == pytest.approx(2.0 - 0.3 / 4.0, abs=2e-3)
    assert angles[1] == pytest.approx(angles[0], abs=2e-3)


def test_cogging_is_a_torque_of_the_angle(bench, one) -> None:
    """The motor accelerates as value sin(count q + phase) / I, and several ripples add up."""
    ripple = one("cogging", count=8.0, phase=0.5)
    arm = bench([ripple], [[0.02]], MOTOR)
    arm.reset(0.1)
    arm.run(0.0, 1)
    expected = 0.02 * np.sin(8.0 * 0.1 + 0.5) * 1e-3 / INERTIA
    assert arm.speed[0] == pytest.approx(expected, rel=1e-9)
    two = bench([ripple], [[0.02]], MOTOR, fixed=[(one("viscous_friction"), (0.0,))])
    two.reset(0.1)
    two.run(0.0, 1)
    assert two.speed[0] == arm.speed[0]


@pytest.mark.parametrize("rise", [0.0, 0.2, 0.5])
def test_asymmetric_friction_brakes_one_way_more(bench, one, rise: float) -> None:
    """K + (rise + 1/2) value against the value's direction, K + (rise - 1/2) value along it."""
    for speed, value in ((2.0, 0.02), (-2.0, 0.02), (-2.0, -0.02)):
        effects = [one("coulomb_friction"), one("asymmetric_friction", free=("rise",))]
        arm = bench(effects, [[0.02, value, rise]], MOTOR)
        arm.reset(w=speed)
        for _ in range(40):
            arm.run(0.0)
        lost = np.abs(speed) - np.abs(arm.speed)
        torque = 0.02 + 0.02 * (rise + 0.5 * np.sign(speed * value))
        assert lost == pytest.approx([torque / INERTIA * 0.04], rel=0.02)


def test_asymmetric_friction_sticks_up_to_another_torque_each_way(bench, one) -> None:
    """With 0.1 and 0.1 more one way: 0.15 holds one way and moves the other, 0.08 holds both."""
    effects = [one("coulomb_friction"), one("asymmetric_friction")]
    for torque, moves in ((0.15, False), (-0.15, True), (0.08, False), (-0.08, False)):
        arm = bench(effects, [[0.1, 0.1]], MOTOR)
        arm.reset()
        assert (abs(arm.hold(torque, 0.5)[0]) > 0.1) == moves
