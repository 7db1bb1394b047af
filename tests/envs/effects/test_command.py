import numpy as np
import pytest

from envs.effects import make

MOTOR = '<motor name="servo" joint="hinge"/>'


def test_delay_shifts_the_motion_by_its_value(bench) -> None:
    """A robot with a delay of k substeps does k substeps later what one without does."""
    commands = np.concatenate([np.zeros(60), 0.5 * np.sin(np.arange(300) * 0.03)])
    arm = bench([make("command_delay")], [[0.0], [0.010], [0.030]])
    arm.reset(ctrl=np.zeros((3, 1)))
    true = arm.run(commands)[0]
    for row, shift in ((1, 10), (2, 30)):
        assert true[shift:, row] == pytest.approx(true[:-shift, 0], abs=1e-9)


def test_delays_between_substeps_are_interpolated(bench) -> None:
    """A linear ramp arrives late by exactly the value, a fraction of a substep included."""
    ramp = np.arange(200) * 1e-3
    arm = bench([make("command_delay")], [[0.0125], [0.013]], MOTOR)
    arm.reset(ctrl=np.zeros((2, 1)))
    forces = []
    for command in ramp:
        arm.run(command)
        forces.append(arm.force.copy())
    late = (ramp[-1] - np.array(forces)[-1]) / 1.0
    assert late == pytest.approx([0.0125, 0.013], abs=1e-9)


def test_a_positive_delay_below_a_substep_is_one_substep(bench) -> None:
    """The engine's finest delay is its time step."""
    arm = bench([make("command_delay")], [[0.0004], [0.001]], MOTOR)
    arm.reset(ctrl=np.zeros((2, 1)))
    arm.run([1.0, 1.0])
    assert arm.force == pytest.approx([1.0, 1.0])
    arm.reset(ctrl=np.zeros((2, 1)))
    arm.run(1.0)
    assert arm.force == pytest.approx([0.0, 0.0])


def test_the_command_from_before_is_the_first_one_unless_given(bench) -> None:
    """Delay lines begin full: of the first command, or of what reset was told."""
    arm = bench([make("command_delay")], [[0.02]])
    arm.reset(0.3)
    assert np.abs(arm.run(np.full(15, 0.3))[0] - 0.3).max() < 1e-12
    arm.reset(0.3, ctrl=np.full((1, 1), 0.3))
    assert np.abs(arm.run(np.zeros(20))[0] - 0.3).max() < 1e-12


def test_a_delay_of_the_model_is_added_to(bench) -> None:
    """The value comes on top of the delay that the model declares."""
    declared = '<motor name="servo" joint="hinge" delay="0.004" nsample="4"/>'
    arm = bench([make("command_delay")], [[0.0], [0.003]], declared)
    arm.reset(ctrl=np.zeros((2, 1)))
    forces = []
    for _ in range(9):
        arm.run(1.0)
        forces.append(arm.force.copy())
    first = (np.array(forces) > 0.5).argmax(0)
    assert list(first) == [4, 7]


def test_the_line_is_as_long_as_asked(bench) -> None:
    """`longest` bounds the value and sizes the memory."""
    arm = bench([make("command_delay", longest=0.25)], [[0.25]], MOTOR)
    arm.reset(ctrl=np.zeros((1, 1)))
    arm.run(np.ones(250))
    assert arm.force[0] == pytest.approx(0.0)
    arm.run(1.0)
    assert arm.force[0] == pytest.approx(1.0)


def test_lost_packets_hold_the_command_before(bench) -> None:
    """Each command is either new or the last that arrived, at the rate of the value."""
    arm = bench([make("packet_loss")], [[0.0], [0.3], [1.0]], MOTOR)
    arm.reset(ctrl=np.full((3, 1), -1.0))
    arrived = []
    for command in range(600):
        arm.plant.step(None, np.full((3, 1), 1e-6 * command), 1)
        arrived.append(arm.plant.ctrl[:, 0].copy())
    sent = 1e-6 * np.arange(600)
    seen = np.array(arrived)
    assert (seen[:, 0] == sent).all()
    assert (seen[:, 2] == -1.0).all()
    lost = seen[:, 1] != sent
    assert lost.mean() == pytest.approx(0.3, abs=0.06)
    assert (seen[1:, 1][lost[1:]] == seen[:-1, 1][lost[1:]]).all()


def test_losses_depend_on_the_seed_alone(bench) -> None:
    """The same seed loses the same packets in any row and beside any other rows."""
    paths = []
    for rows, row in ((1, 0), (3, 2)):
        arm = bench([make("packet_loss")], [[0.5]] * rows, MOTOR)
        ids = np.arange(rows)
        seeds = np.full(rows, 7, np.uint64)
        arm.plant.reset(ids, np.zeros((rows, 1)), np.zeros((rows, 1)), seeds)
        arrived = []
        for command in range(50):
            arm.plant.step(None, np.full((rows, 1), float(command)), 1)
            arrived.append(arm.plant.ctrl[row, 0])
        paths.append(arrived)
    assert paths[0] == paths[1]


def goals(arm, target: float, steps: int) -> np.ndarray:
    """Return what the servo is told while the target stands, (steps, n)."""
    out = []
    for _ in range(steps):
        arm.run(target)
        out.append(arm.plant.ctrl[:, 0].copy())
    return np.array(out)


def test_profile_velocity_is_the_slope_of_the_goal(bench, one) -> None:
    """A step becomes a ramp of that slope, which ends on the target."""
    arm = bench([one("profile_velocity")], [[2.0], [1e6]])
    arm.reset(ctrl=np.zeros((2, 1)))
    goal = goals(arm, 1.0, 600)
    assert np.diff(goal[:499, 0]) == pytest.approx(2e-3)
    assert goal[-1, 0] == 1.0
    assert (goal[:, 1] == 1.0).all()


def test_the_smallest_of_several_limits_holds(bench, one) -> None:
    """A limit of all servos that is absent takes none away from a single one."""
    both = [one("profile_velocity"), make("profile_velocity")]
    arm = bench(both, [[2.0, 1e6], [1e6, 3.0], [2.0, 3.0]])
    arm.reset(ctrl=np.zeros((3, 1)))
    assert np.diff(goals(arm, 1.0, 200)[1:], axis=0).mean(axis=0) == pytest.approx(
        [2e-3, 3e-3, 2e-3]
    )


def test_a_limit_that_appears_in_motion_starts_from_the_goal_in_force(bench, one) -> None:
    """Without a reset: what was free until then is at its last target."""
    arm = bench([one("profile_velocity")], [[1e6]])
    arm.reset(ctrl=np.zeros((1, 1)))
    goals(arm, 1.0, 50)
    arm.plant.set_params(np.zeros(1, int), np.array([[2.0]]))
    goal = goals(arm, 0.5, 100)[:, 0]
    assert goal[0] == pytest.approx(1.0, abs=0.5)
    assert np.diff(goal) == pytest.approx(-2e-3)


def test_profile_acceleration_makes_a_triangle(bench, one) -> None:
    """A step of d takes 2 sqrt(d / a), speeds up and slows down by a, and does not overshoot."""
    hard, way = 20.0, 1.0
    arm = bench([one("profile_acceleration")], [[hard]])
    arm.reset(ctrl=np.zeros((1, 1)))
    goal = goals(arm, way, 700)[:, 0]
    assert np.abs(np.diff(goal, 2)).max() <= hard * 1e-6 * 1.1  # the last step rounds the stop
    assert goal.max() <= way
    arrival = (goal < way - 1e-9).sum() * 1e-3
    assert arrival == pytest.approx(2 * np.sqrt(way / hard), rel=0.02)
    assert np.diff(goal).max() * 1e3 == pytest.approx(np.sqrt(way * hard), rel=0.02)


def test_both_limits_make_a_trapezoid(bench, one) -> None:
    """Two effects share one profile: it cruises at the velocity, with ramps of the acceleration."""
    effects = [one("profile_velocity"), one("profile_acceleration")]
    arm = bench(effects, [[2.0, 20.0]])
    arm.reset(ctrl=np.zeros((1, 1)))
    goal = goals(arm, 1.0, 800)[:, 0]
    speed = np.diff(goal) * 1e3
    assert speed.max() == pytest.approx(2.0)
    assert np.abs(np.diff(speed)).max() <= 20e-3 * 1.1
    assert (goal < 1.0 - 1e-9).sum() * 1e-3 == pytest.approx(1.0 / 2.0 + 2.0 / 20.0, rel=0.02)
    assert goal[-1] == 1.0


def test_a_profile_follows_a_target_that_turns_back(bench, one) -> None:
    """The goal brakes, turns and arrives, within its limits at all times."""
    arm = bench([one("profile_velocity"), one("profile_acceleration")], [[2.0, 20.0]])
    arm.reset(ctrl=np.zeros((1, 1)))
    goal = np.concatenate([goals(arm, 1.0, 300), goals(arm, -0.5, 1500)])[:, 0]
    assert np.abs(np.diff(goal, 2)).max() <= 20e-6 * 1.1
    assert goal[-1] == -0.5
