"""The 500-step Hopper of the transfer studies."""

from typing import Any

import numpy as np
import pytest

from envs.errors import TaskError
from envs.simulation import Simulation
from envs.tasks import Hopper, HopperPolito

NATIVE = (3.665, 4.058, 2.781, 5.316)  # kg: torso, thigh, leg, foot, as this engine computes them
LEGACY = (3.534, 3.927, 2.714, 5.089)  # kg, as mujoco-py computed them


@pytest.mark.parametrize(
    ("masses", "domain", "expected"),
    [
        ("native", "target", NATIVE),
        ("legacy", "target", LEGACY),
        ("native", "source", (2.665, *NATIVE[1:])),
        ("legacy", "source", (2.534, *LEGACY[1:])),
    ],
)
def test_masses(masses: Any, domain: Any, expected: tuple[float, ...]) -> None:
    """Bodies weigh what the studies measured; the source's torso weighs one kilogram less."""
    model = HopperPolito(domain=domain, masses=masses).spec().compile()
    np.testing.assert_allclose(model.body_mass[1:], expected, atol=1e-3)


def test_only_masses_differ_from_the_hopper() -> None:
    """The native target has the masses, inertias and centres of mass of Gymnasium's Hopper."""
    ours, plain = HopperPolito(domain="target").spec().compile(), Hopper().spec().compile()
    np.testing.assert_allclose(ours.body_mass, plain.body_mass, rtol=1e-12)
    np.testing.assert_allclose(ours.body_inertia, plain.body_inertia, rtol=1e-12)
    np.testing.assert_allclose(ours.body_ipos, plain.body_ipos, atol=1e-12)


def test_ends_after_500_steps_and_shows_raw_velocities() -> None:
    """The limit is 500 steps, velocities are not clipped, the falling step is paid its bonus."""
    simulation = Simulation(HopperPolito(), num_rows=1, threads=1)
    one = np.arange(1)
    simulation.reset(one, np.zeros((1, 0)), np.zeros(1, np.uint64))
    assert simulation.max_steps == 500
    fast = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 25.0]])
    qpos = simulation.task.start[None].copy()
    assert simulation.set_state(one, qpos, fast)[0, -1] == 25.0
    qpos[0, 2] = 0.3  # rad, at which it counts as fallen
    simulation.set_state(one, qpos, np.zeros((1, 6)))
    step = simulation.step(None, np.zeros((1, 3)))
    assert step.terminated[0]
    assert step.reward[0] > 0.5


def test_names_are_checked() -> None:
    """An unknown choice is refused with the nearest one."""
    with pytest.raises(TaskError, match=r"masses='legcy'.*did you mean 'legacy'.*legacy, native"):
        HopperPolito(masses="legcy")  # type: ignore[arg-type]
    with pytest.raises(TaskError, match="domain='sim'"):
        HopperPolito(domain="sim")  # type: ignore[arg-type]
