"""EASI's ant: what it observes in its own frame, what it is paid, its eleven parameters."""

import numpy as np
import pytest

from envs.simulation import Simulation
from envs.tasks import EasiAnt
from envs.tasks.easi_ant import FREE
from sim2real.config.compose import compose
from sim2real.config.targets import build

ONE = np.arange(1)


def put(qpos: np.ndarray | None = None, qvel: np.ndarray | None = None) -> Simulation:
    """Return an ant in a state; what is None stays at its start."""
    simulation = Simulation(EasiAnt(), 1, threads=1)
    simulation.reset(ONE, np.zeros((1, 0)), np.zeros(1, np.uint64))
    state = simulation.state()
    start = simulation.task.start[None]
    speeds = np.zeros_like(state.qvel) if qvel is None else qvel
    simulation.set_state(ONE, start if qpos is None else qpos, speeds)
    return simulation


def test_it_sees_velocities_in_its_own_frame() -> None:
    """Turned by a quarter to the left, a motion along x is one to its right."""
    plain = put()
    qpos, qvel = plain.task.start[None].copy(), np.zeros((1, 14))
    qpos[0, 3:FREE] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    qvel[0, 0] = 2.0
    seen = put(qpos, qvel).state()
    observed = plain.task.observe(seen)[0]
    np.testing.assert_allclose(observed[1:4], [0.0, -2.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(observed[7:12], [np.pi / 2, 0, -np.pi / 2, 1, 0], atol=1e-9)
    assert observed.shape == (60,)


def test_what_it_is_paid() -> None:
    """0.5 alive, 0.1 upright, 0.5 ahead and the speed; what actions, power and ends cost."""
    simulation = put()
    task, before = simulation.task, simulation.state()
    after = simulation.state()
    after.qpos[:, 0] += 2.0 * task.dt  # at 2 m/s
    after.qpos[:, FREE:] = [0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0]
    still = np.zeros((1, 8))
    no = np.zeros(1, bool)
    assert task.reward(before, after, still, no)[0] == pytest.approx(3.1, abs=1e-6)
    assert task.reward(before, after, still, ~no)[0] == -2.0
    after.qvel[:, 6:] = 3.0
    cost = 0.005 * 8 * 0.25 + 0.05 * 8 * 0.5 * 0.2 * 3.0
    assert task.reward(before, after, still + 0.5, no)[0] == pytest.approx(3.1 - cost, abs=1e-6)
    after.qpos[:, FREE] = np.radians(40)
    assert task.reward(before, after, still, no)[0] == pytest.approx(3.0, abs=1e-6)
    after.qpos[:, 2] = 0.3
    assert task.terminated(after)[0]


def test_it_stands_on_its_feet_and_feels_them() -> None:
    """Without torque it settles without a failure; the feet carry forces, the last action shows."""
    simulation = put()
    for _ in range(30):
        step = simulation.step(None, np.full((1, 8), 0.01))
    assert not step.failed.any()
    assert np.abs(step.observation[0, 28:52]).max() > 0.05
    np.testing.assert_allclose(step.observation[0, 52:], 0.01)


def test_eleven_parameters_of_several_places_each() -> None:
    """One value for all four hips, ankles, feet or legs; the neutral ones are the target's."""
    tasks = build(compose(["+experiment=easi_ant"])["params"], "params")
    simulation = Simulation(EasiAnt(), 2, tasks.effects, 1)
    tasks.check(simulation.space)
    assert simulation.space.size == 11
    values = np.tile(simulation.space.neutral, (2, 1))
    values[1, simulation.space.index("armature.hip_*")] = 2.0
    values[1, simulation.space.index("link_mass.leg_*")] = 3.0
    simulation.reset(np.arange(2), values, np.zeros(2, np.uint64))
    plant = simulation.plant
    np.testing.assert_allclose(plant.field("dof_armature")[1, 6:], [0.2, 0.1] * 4)
    np.testing.assert_allclose(
        np.sort(plant.field("body_mass")[1, 1:]), [0.1] * 4 + [0.6] * 4 + [1]
    )
    np.testing.assert_array_equal(plant.field("dof_armature")[0], plant.model.dof_armature)
