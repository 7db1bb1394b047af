"""Which effects no recording can part, since they make the same equations of motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from envs.plant import Plant
from sim2real.diagnosis.attribution.equivalents import inseparable
from sim2real.diagnosis.attribution.same_dynamics import Pair, same_dynamics, twins
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.attribution.test_equivalents import option, search_of

ROTOR = 0.004  # kg·m²


def same(one: Pair, other: Pair) -> bool:
    """Return whether two effects of the arm make the same equations of motion."""
    return same_dynamics(arm.spec(), one, other, DEFAULT.causes)


@pytest.fixture
def pairs(tmp_path: Path) -> dict[str, Pair]:
    """Return effects of the arm that make about as much inertia, and two of its motors."""
    model = arm.spec().compile()
    sizes = {
        **{f"armature.{joint}": ROTOR for joint in arm.JOINTS},
        **{
            f"link_inertia.{body}": 1 + ROTOR / model.body(body).inertia[0]
            for body in ("upper", "lower")
        },
        "motor_strength.a": 0.7,
        "position_gain.a": 0.7,
        "viscous_friction.a": 0.1,
    }
    search = search_of(arm.make_log(seconds=4.0), tmp_path, *sizes)
    return {label: (option(search, label), np.array([size])) for label, size in sizes.items()}


def test_a_rotor_is_the_inertia_of_a_link_that_turns_about_its_axis_alone(
    pairs: dict[str, Pair],
) -> None:
    """Told from values that a log gave roughly; the last link turns with the first as well."""
    rotor, (link, size) = pairs["armature.a"], pairs["link_inertia.upper"]
    assert same(rotor, (link, 1.1 * size))
    assert same((link, size), (rotor[0], 0.9 * rotor[1]))
    assert not same(pairs["armature.b"], pairs["link_inertia.lower"])
    assert not same(rotor, (link, 2 * size))  # other logs gave that


def test_a_twin_is_found_however_far_from_its_probes(pairs: dict[str, Pair]) -> None:
    """A rotor that makes three times a link's inertia: the link's is probed at less than twice."""
    (rotor, size), (link, times) = pairs["armature.a"], pairs["link_inertia.upper"]
    wanted = np.array([3.06])
    assert wanted > 1.5 * link.probes.max()
    large = size * (wanted - 1) / (times - 1)
    options = [option for option, _ in pairs.values()]
    others = [option for option in options if option is not rotor]
    (found,) = twins(arm.spec(), (rotor, large), others, DEFAULT.causes)
    assert found[0] is link and found[1] == pytest.approx(wanted)
    others = [option for option in options if option is not link]
    (found,) = twins(arm.spec(), (link, wanted), others, DEFAULT.causes)
    assert found[0] is rotor and found[1] == pytest.approx(large)
    friction = pairs["viscous_friction.a"]
    assert list(twins(arm.spec(), friction, options[:2], DEFAULT.causes)) == []


def test_the_same_equations_make_the_same_motion(pairs: dict[str, Pair]) -> None:
    """What is called the same moves alike to the last digits, from a swing at any amplitude."""
    paths = []
    for label, field in (("armature.a", "armature"), ("link_inertia.upper", "link_inertia")):
        plant = Plant(arm.spec(), [make(field, where=label.split(".")[1])], 1, threads=1)
        plant.set_params(np.zeros(1, int), pairs[label][1][None])
        start = np.array([[2.0, -1.0]]), np.array([[3.0, 5.0]])
        plant.reset(np.zeros(1, int), *start, np.zeros(1, int))
        path = []
        for _ in range(200):
            plant.step(None, np.array([[0.4, -0.3]]), 1)
            path.append(plant.qpos.copy())
        paths.append(np.array(path))
    np.testing.assert_allclose(paths[0], paths[1], rtol=0, atol=1e-9)
    assert np.ptp(paths[0]) > 1.0


def test_what_is_parted_at_a_limit_or_acts_elsewhere_is_not_the_same(
    pairs: dict[str, Pair],
) -> None:
    """A gain has no limit of force; a joint's damping is no inertia."""
    weak, gain = pairs["motor_strength.a"], pairs["position_gain.a"]
    assert not same(weak, gain)
    assert not same(gain, weak)
    assert not same(pairs["viscous_friction.a"], pairs["armature.a"])


def test_a_search_calls_them_inseparable(tmp_path: Path, pairs: dict[str, Pair]) -> None:
    """They count as one member of a set."""
    search = search_of(arm.make_log(seconds=4.0), tmp_path, "armature.a", "link_inertia.upper")
    assert inseparable(search, pairs["armature.a"], pairs["link_inertia.upper"])
