"""Friction with bristles: what sticks, what slides, and how."""

import numpy as np
import pytest

from sim2real.exam.thirdparty.friction import BEND, Bristles, Friction

STEP, INERTIA = 0.0005, 0.01


def settled(law: Friction, speed: float, angle: float = 0.0, load: float = 0.0) -> float:
    """Return the torque of steady sliding [N·m]."""
    rub = Bristles(law, INERTIA, STEP)
    return [rub(speed, angle, load) for _ in range(4000)][-1]


@pytest.mark.parametrize("speed", [0.02, 0.5, 40.0])
def test_sliding_costs_dry_and_viscous_friction(speed: float) -> None:
    """At any speed, however large a step's way is against the bend."""
    law = Friction(coulomb=0.1, viscous=0.02)
    assert settled(law, speed) == pytest.approx(0.1 + 0.02 * speed)
    assert settled(law, -speed) == pytest.approx(-0.1 - 0.02 * speed)


def test_bristles_bend_before_they_slip() -> None:
    """Far below the breaking torque the joint moves by less than the bend, and springs back."""
    rub = Bristles(Friction(coulomb=0.1), INERTIA, STEP)
    speed = angle = 0.0
    path = []
    for k in range(20000):
        speed += STEP * ((0.05 if k < 10000 else 0.0) - rub(speed, angle, 0.0)) / INERTIA
        angle += STEP * speed
        path.append(angle)
    assert 0.3 * BEND < path[9999] < BEND
    assert abs(speed) < 1e-6
    assert path[-1] < 0.6 * path[9999]


def test_laws_add_up() -> None:
    """Stribeck's excess dies with speed; load, direction and a worn angle add dry friction."""
    assert settled(Friction(excess=0.1, speed=0.2), 0.01) == pytest.approx(0.1, rel=0.01)
    assert settled(Friction(excess=0.1, speed=0.2), 1.0) == pytest.approx(0.0, abs=1e-6)
    assert settled(Friction(load=0.2), 1.0, load=-3.0) == pytest.approx(0.6)
    skew = Friction(coulomb=0.3, skew=0.1)
    assert settled(skew, 1.0) == pytest.approx(0.4)
    assert settled(skew, -1.0) == pytest.approx(-0.2)
    worn = Friction(worn=0.1, worn_at=0.5, worn_width=0.05)
    assert settled(worn, 1.0, angle=0.5) == pytest.approx(0.1)
    assert settled(worn, 1.0, angle=0.8) == pytest.approx(0.0, abs=1e-6)


def test_grease_warms_up() -> None:
    """Cold grease rubs more, and less as time goes by."""
    rub = Bristles(Friction(grease=0.1, warm_up=0.5), INERTIA, STEP)
    torque = np.array([rub(1.0, 0.0, 0.0) for _ in range(2000)])
    assert torque[0] == pytest.approx(0.1)
    assert torque[-1] == pytest.approx(0.1 * np.exp(-2), rel=0.01)
