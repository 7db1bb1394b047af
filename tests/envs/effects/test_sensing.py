import numpy as np
import pytest

from envs.effects import make

MOTOR = '<motor name="servo" joint="hinge"/>'


def test_readings_are_late_by_exactly_the_delay(bench) -> None:
    """Delays of whole control steps repeat former states to the bit; the truth is not late."""
    arm = bench([make("observation_delay")], [[0.0], [0.010], [0.050]])
    arm.reset(0.1, 1.0)
    true, measured = arm.run(0.4 * np.sin(np.arange(100) * 0.1), nstep=5)
    assert (measured[:, 0] == true[:, 0]).all()
    for row, steps in ((1, 2), (2, 10)):
        assert measured[steps:, row] == pytest.approx(true[:-steps, row], abs=1e-9)
        assert measured[:steps, row] == pytest.approx(0.1)
    assert (true == true[:, :1]).all()


def test_delays_between_control_steps_follow_the_motion(bench) -> None:
    """A reading from between two control steps is right to a microradian on a smooth motion."""
    arm = bench([make("observation_delay")], [[0.0072]])
    arm.reset(0.5)
    fine, coarse = [], []
    for _ in range(100):
        arm.run(0.0, nstep=5)
        coarse.append(arm.plant.measured(None)[0][0, 0])
    arm.reset(0.5)
    for _ in range(500):
        arm.run(0.0)
        fine.append(arm.plant.qpos[0, 0])
    times = np.arange(1, 501) * 1e-3
    expected = np.interp(np.arange(1, 101) * 5e-3 - 0.0072, times, fine)
    assert np.abs(np.array(coarse) - expected)[4:].max() < 5e-5


def test_a_wrong_zero_shows_in_the_log_or_in_the_loop(bench, one) -> None:
    """Measured = true + value always; a servo with that zero settles at goal - value."""
    for servo, settled in ((0, 0.3), (1, 0.25)):
        arm = bench([one("encoder_offset", servo=servo)], [[0.05]])
        arm.reset()
        true, measured = arm.run(np.full(3000, 0.3))
        assert true[-1, 0] == pytest.approx(settled, abs=1e-5)
        assert measured[-1, 0] == pytest.approx(settled + 0.05, abs=1e-5)


def test_goals_are_limited_in_the_encoders_own_angle(bench, one) -> None:
    """A servo with a wrong zero clamps its goal as it reads it."""
    arm = bench([one("encoder_offset")], [[0.05]])
    arm.reset(3.0)
    assert arm.run(np.full(4000, 9.0))[1][-1, 0] == pytest.approx(3.0, abs=1e-4)


def test_a_measured_start_is_turned_into_the_true_one(bench, one) -> None:
    """What the encoder says at the start of a log is its own angle."""
    arm = bench([one("encoder_offset")], [[0.05]])
    arm.reset(0.2, measured=True)
    assert arm.plant.qpos[0, 0] == pytest.approx(0.15)
    assert arm.plant.measured(None)[0][0, 0] == pytest.approx(0.2)


def test_noise_has_its_size_and_repeats_with_the_seed(bench, one) -> None:
    """Readings scatter by the value, independently from step to step, the same for one seed."""
    arm = bench([one("sensor_noise")], [[0.0], [0.01]])
    logs = []
    for _ in range(2):
        arm.reset()
        logs.append(arm.run(np.zeros(3000))[1])
    assert (logs[0] == logs[1]).all()
    assert (logs[0][:, 0] == 0.0).all()
    noise = logs[0][:, 1]
    assert noise.std() == pytest.approx(0.01, rel=0.05)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.05


def test_reading_twice_says_the_same(bench, one) -> None:
    """A measurement belongs to a moment, not to who asks."""
    arm = bench([one("sensor_noise"), one("velocity_filter")], [[0.01, 0.02]])
    arm.reset(0.0, 1.0)
    arm.run(0.3, 5)
    first, second = arm.plant.measured(None), arm.plant.measured(np.array([0]))
    assert first[0] == second[0]
    assert first[1] == second[1]


def test_quantized_readings_are_multiples_of_the_step(bench, one) -> None:
    """Readings are the nearest multiple; the truth is not rounded."""
    step = 2 * np.pi / 4096
    arm = bench([one("quantization")], [[step]])
    arm.reset()
    true, measured = arm.run(np.linspace(0, 0.5, 400))
    assert measured / step == pytest.approx(np.round(measured / step), abs=1e-9)
    assert np.abs(true - measured).max() <= step / 2 + 1e-12
    assert np.abs(true - measured).max() > 0.3 * step


def test_the_reported_speed_lags_by_its_time_constant(bench, one) -> None:
    """After a steady acceleration the filtered speed is late by tau, whatever the control step."""
    tau, inertia = 0.02, 0.001 + 1e-4 + 0.2 * 0.1**2
    for nstep in (1, 10):
        arm = bench([one("velocity_filter")], [[0.0], [tau]], MOTOR)
        arm.reset()
        arm.run(np.full(300 // nstep, 0.01), nstep)
        true, said = arm.speed, arm.plant.measured(None)[1][:, 0]
        assert said[0] == true[0]
        assert true[1] - said[1] == pytest.approx(0.01 / inertia * tau, rel=1e-3)


def test_the_chain_is_sampled_offset_noise_then_rounded(bench, one) -> None:
    """However the effects are listed, a reading is round(true then + offset) to counts."""
    names = ["quantization", "encoder_offset", "observation_delay"]
    values = {"quantization": 0.01, "encoder_offset": 0.004, "observation_delay": 0.003}
    logs = []
    for order in (names, names[::-1]):
        effects = [one(n, servo=0) if n == "encoder_offset" else one(n) for n in order]
        arm = bench(effects, [[values[n] for n in order]])
        arm.reset(0.2)
        true, measured = arm.run(np.linspace(0.2, 0.4, 200))
        logs.append(measured)
        expected = np.round((true[:-3] + 0.004) / 0.01) * 0.01
        assert measured[3:] == pytest.approx(expected, abs=1e-9)
    assert (logs[0] == logs[1]).all()


def test_a_late_reading_is_the_motors_of_then(bench, one) -> None:
    """With play before the encoder, the delay is that of the motor's angle, not of the link's."""
    logs = []
    for delay in (0.0, 0.010):
        arm = bench([one("backlash"), make("observation_delay")], [[0.05, delay]], gravity=9.81)
        arm.reset(0.1)
        logs.append(arm.run(0.5 * np.sin(np.arange(200) * 0.1), nstep=5)[1])
    assert logs[1][2:] == pytest.approx(logs[0][:-2], abs=1e-9)
