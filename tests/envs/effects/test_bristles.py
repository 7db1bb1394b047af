import numpy as np
import pytest

WEIGHT = 0.2 * 9.81 * 0.1  # of the level link [N·m]
MOTOR = '<motor name="servo" joint="hinge"/>'


def test_a_joint_at_rest_is_held_where_it_starts(bench, one) -> None:
    """Its load bends its bristles from the first step on; they give way beyond their torque."""
    stuck = one("stribeck_friction", bristle=0.005)
    arm = bench([stuck], [[1.5 * WEIGHT], [0.5 * WEIGHT]], MOTOR, gravity=9.81)
    arm.reset()
    end = arm.hold(0.0, 0.2)
    assert abs(end[0]) < 2e-5
    assert abs(end[1]) > 0.3


def test_it_gives_way_before_it_breaks_away(bench, one) -> None:
    """Under a slow pull the joint follows Dahl's curve, x = -b ln(1 - tau / K), and comes back."""
    friction, bend = 0.2, 0.004
    arm = bench([one("stribeck_friction", speed=50.0, bristle=bend)], [[friction]], MOTOR)
    arm.reset()
    ramp = np.linspace(0, 0.6, 3000) * friction
    pulled = arm.run(ramp)[0][:, 0]
    curve = -bend * np.log(1 - ramp / friction)
    assert pulled[-1] == pytest.approx(curve[-1], rel=0.03)
    assert pulled[1000] == pytest.approx(curve[1000], rel=0.05)
    assert arm.run(ramp[::-1])[0][-1, 0] < 0.5 * pulled[-1]


def test_it_rings_as_damped_as_in_the_paper(bench, one) -> None:
    """A step far below the friction overshoots as a linear oscillator of half critical damping."""
    friction, step, ratio = 0.2, 0.004, 0.5  # table I: s0 = 1e5, s1 = sqrt(1e5), a unit mass
    bent = one("stribeck_friction", speed=50.0, bristle=0.1, ratio=ratio)
    arm = bench([bent], [[friction]], MOTOR)
    arm.reset()
    path = arm.run(np.repeat([0.0, step], [20, 1500]))[0][:, 0]
    overshoot = np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))
    assert path.max() / path[-1] - 1 == pytest.approx(overshoot, rel=0.1)


@pytest.mark.parametrize("bend", [1e-6, 1e-4, 0.02])
def test_any_stiffness_is_stable(bench, one, bend: float) -> None:
    """The least deflection is nearly the engine's own rigid friction."""
    commands = 0.5 * np.sin(np.arange(2000) * 0.006)
    paths = []
    for bristle in (bend, 0.0):
        arm = bench([one("stribeck_friction", speed=0.3, bristle=bristle)], [[0.1]], gravity=9.81)
        arm.reset()
        paths.append(arm.run(commands)[0][:, 0])
    assert np.isfinite(paths[0]).all()
    assert np.abs(paths[0] - paths[1]).max() < 0.02 + bend


def test_without_deflection_nothing_changes(bench, one) -> None:
    """Rows with rigid friction move as if no row had bristles, to the last bit."""
    free = one("stribeck_friction", free=("bristle",))
    both = bench([free], [[0.1, 0.0], [0.1, 0.01]], gravity=9.81)
    alone = bench([one("stribeck_friction")], [[0.1]], gravity=9.81)
    commands = 0.5 * np.sin(np.arange(500) * 0.006)
    for arm in (both, alone):
        arm.reset()
    path = both.run(commands)[0]
    assert (path[:, 0] == alone.run(commands)[0][:, 0]).all()
    assert np.abs(path[:, 1] - path[:, 0]).max() > 1e-3
