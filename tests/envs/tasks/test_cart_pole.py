"""EASI's cart-pole: its equations of motion, its drive, its rewards."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.simulation import Simulation
from envs.tasks import CartPole
from sim2real.config.compose import compose
from sim2real.config.targets import build

ONE, SEED = np.arange(1), np.zeros(1, np.uint64)
CART, POLE, LENGTH, ARMATURE, DAMPING = 0.3, 0.1, 0.3, 5e-3, 2e-3  # kg, kg, m, kg·m², N·m·s
HINGE, RAIL, GRAVITY = 3e-4, 1e-2, 9.81  # N·m, N, m/s²
ELEVEN = 11


class Fine(CartPole):
    """The same with a hundred times as many substeps."""

    frame_skip = 400

    def spec(self) -> mujoco.MjSpec:
        """Return the model with short substeps."""
        spec = super().spec()
        spec.option.timestep /= 100
        return spec


def started(
    qpos: tuple[float, float], qvel: tuple[float, float], kind: type[CartPole] = CartPole
) -> Simulation:
    """Return a cart-pole in a state."""
    simulation = Simulation(kind(), 1, threads=1)
    simulation.reset(ONE, np.zeros((1, 0)), SEED)
    simulation.set_state(ONE, np.array([qpos]), np.array([qvel]))
    return simulation


def accelerations(qpos: np.ndarray, qvel: np.ndarray, goal: float) -> np.ndarray:
    """Return those of the cart and the pole by Lagrange's equations, of a thin rod of 6 mm."""
    half, angle, spin = LENGTH / 2, qpos[1], qvel[1]
    inertia = POLE * (LENGTH**2 + 0.006**2) / 12 + POLE * half**2 + ARMATURE
    coupling = POLE * half * np.cos(angle)
    mass = np.array([[CART + POLE, coupling], [coupling, inertia]])
    force = 20 * (goal - qpos[0]) - 0.3 * qvel[0] - RAIL * np.sign(qvel[0])
    force += POLE * half * spin**2 * np.sin(angle)
    torque = POLE * GRAVITY * half * np.sin(angle) - DAMPING * spin - HINGE * np.sign(spin)
    return np.linalg.solve(mass, [force, torque])


def test_it_moves_as_a_cart_and_a_pole_do() -> None:
    """One control step agrees with the integrated equations of motion."""
    qpos, qvel = np.array([0.02, 0.3]), np.array([0.1, -0.5])
    simulation = started((0.02, 0.3), (0.1, -0.5), Fine)
    step = simulation.step(None, np.array([[0.4]]))
    fine = 2000
    for _ in range(fine):
        qvel = qvel + accelerations(qpos, qvel, 0.4 * 0.2) * 0.02 / fine
        qpos = qpos + qvel * 0.02 / fine
    seen = step.observation[0]
    np.testing.assert_allclose(seen[[0, 2]], qpos, atol=1e-5)
    np.testing.assert_allclose(seen[[1, 3]], qvel, atol=1e-3)


def test_the_drive_has_a_speed_limit() -> None:
    """Without load it comes near to 0.6 m/s, and passes it by one substep's push at most."""
    simulation = started((-0.17, 0.0), (0.0, 0.0))
    speeds = [simulation.step(None, np.ones((1, 1))).observation[0, 1] for _ in range(15)]
    assert 0.5 < max(speeds) < 0.6 + 5 / 0.4 * 0.005
    free = Simulation(CartPole(), 1, [make("torque_speed_knee", where="slider")], 1)
    free.reset(ONE, np.array([[1e6]]), SEED)
    free.set_state(ONE, np.array([[-0.17, 0.0]]), np.zeros((1, 2)))
    assert max(free.step(None, np.ones((1, 1))).observation[0, 1] for _ in range(15)) > 0.9


@pytest.mark.parametrize(
    ("qpos", "ends"), [((0.0, 0.1), False), ((0.19, 0.0), True), ((0.0, 1.65), True)]
)
def test_rewards_and_ends(qpos: tuple[float, float], ends: bool) -> None:
    """Upright and quiet pays nearly 1; the edge of the rail and a fallen pole cost 2."""
    step = started(qpos, (0.0, 0.0)).step(None, np.array([[qpos[0] / 0.2]]))
    _, speed, angle, spin = step.observation[0]
    paid = 1 - angle**2 - 0.01 * abs(speed) - 0.005 * abs(spin)
    assert step.terminated[0] == ends
    assert step.reward[0] == pytest.approx(-2.0 if ends else paid)


def test_starts_are_uniform() -> None:
    """Positions within 0.1 and velocities within 0.2, all over that range."""
    qpos, qvel = CartPole().initial(np.arange(2000, dtype=np.uint64))
    for values, half in ((qpos, 0.1), (qvel, 0.2)):
        assert np.abs(values).max() <= half
        np.testing.assert_allclose(values.mean(0), 0.0, atol=0.05 * half)
        np.testing.assert_allclose(values.std(0), half / np.sqrt(3), rtol=0.05)


def test_the_eleven_parameters_around_the_target() -> None:
    """The model's own values are those of the target, and each is drawn from a third to triple."""
    tasks = build(compose(["+experiment=easi_cartpole"])["params"], "params")
    space = Simulation(CartPole(), 1, tasks.effects, 1).space
    tasks.check(space)
    drawn = tasks.sample(np.random.default_rng(0), 4000)
    assert drawn.shape == (4000, ELEVEN)
    target = np.where(space.neutral == 1e6, 0.48, space.neutral)
    np.testing.assert_allclose(drawn.min(0) / target, 1 / 3, rtol=0.05)
    np.testing.assert_allclose(drawn.max(0) / target, 3.0, rtol=0.05)


def test_a_pole_of_another_density_weighs_and_turns_in_proportion() -> None:
    """`inertia: scaled` scales mass and inertia alike; `kept` the mass alone."""
    for kind, factor in (("scaled", 2.0), ("kept", 1.0)):
        effect = make("link_mass", where="pole", how="scale", inertia=kind)
        plant = Simulation(CartPole(), 1, [effect], 1).plant
        plant.set_params(ONE, np.array([[2.0]]))
        np.testing.assert_allclose(plant.field("body_mass")[0, 2], 2 * POLE)
        np.testing.assert_allclose(
            plant.batch.expand("body_inertia")[0, 2], factor * plant.model.body_inertia[2]
        )
