"""EASI's BallBalance: pinned feet, goals that move, rewards, and a ball that rolls off."""

import numpy as np
import pytest

from envs.simulation import Simulation
from envs.tasks import BallBalance
from envs.tasks.ball_balance import BALL
from sim2real.config.compose import compose
from sim2real.config.targets import build

ROWS = 4
IDS, SEEDS = np.arange(ROWS), np.arange(ROWS, dtype=np.uint64)


@pytest.fixture
def simulation() -> Simulation:
    """Four rows at their starts."""
    made = Simulation(BallBalance(), ROWS, threads=1)
    made.reset(IDS, np.zeros((ROWS, 0)), SEEDS)
    return made


def test_the_feet_stay_and_the_goals_move(simulation: Simulation) -> None:
    """A small step of the goals lowers or lifts the tray; no foot moves by 5 mm."""
    feet = [simulation.plant.nominal.body(f"lower_{i}").id for i in range(3)]
    positions = simulation.plant.batch.bind("xpos")
    turns = simulation.plant.batch.bind("xmat")
    for sign in (1.0, -1.0):
        for _ in range(3):
            simulation.step(None, np.full((ROWS, 3), 0.05 * sign))
            assert simulation.plant.ctrl.max() <= np.pi / 2 + 1e-9
        axes = turns.reshape(ROWS, -1, 3, 3)[:, feet]
        foot = positions[:, feet] + axes @ np.array([0.254558, 0.0, -0.254558])
        np.testing.assert_allclose(foot[..., 2], 0.02, atol=5e-3)
        np.testing.assert_allclose(np.linalg.norm(foot[..., :2], axis=-1), 0.4, atol=5e-3)
    np.testing.assert_allclose(simulation.plant.ctrl, 0.0, atol=1e-9)


def test_starts_are_thrown_inwards() -> None:
    """1 to 2 m high, within half a metre, towards the middle, 2 m/s down."""
    task = BallBalance()
    task.setup(task.spec().compile())
    qpos, qvel = task.initial(np.arange(500, dtype=np.uint64))
    ball, speed = qpos[:, BALL : BALL + 3], qvel[:, 12:15]
    assert 1.0 <= ball[:, 2].min() < 1.05
    assert 1.95 < ball[:, 2].max() <= 2.0
    assert np.linalg.norm(ball[:, :2], axis=1).max() <= 0.5
    assert ((ball[:, :2] * speed[:, :2]).sum(1) <= 0).all()
    assert (speed[:, 2] == -2.0).all()


def test_rewards_and_ends(simulation: Simulation) -> None:
    """The best is a ball that stands 0.5 m high in the middle; below 0.3 m it is over."""
    state = simulation.state()
    state.qpos[:, BALL : BALL + 3] = [[0, 0, 0.5], [0.3, 0.4, 0.5], [0, 0, 1.0], [0, 0, 0.29]]
    state.qvel[:] = 0.0
    paid = simulation.task.reward(state, state, np.zeros((ROWS, 3)), np.zeros(ROWS, bool))
    np.testing.assert_allclose(paid[:3], [1.0, 1 / 1.5**2, 1 / (1 + np.sqrt(0.5)) ** 2])
    assert simulation.task.terminated(state).tolist() == [False, False, False, True]
    state.qvel[:, 12:15] = [0.0, 3.0, 4.0]
    moving = simulation.task.reward(state, state, np.zeros((ROWS, 3)), np.zeros(ROWS, bool))
    np.testing.assert_allclose(moving, paid / 6)


def test_seven_parameters_and_heavier_balls_press_the_tray_down() -> None:
    """All are drawn around the target's; three times the ball's mass lowers the tray."""
    tasks = build(compose(["+experiment=easi_ball_balance"])["params"], "params")
    simulation = Simulation(BallBalance(), 2, tasks.effects, 1)
    tasks.check(simulation.space)
    assert simulation.space.size == 7
    values = np.tile(simulation.space.neutral, (2, 1))
    values[1, 0] = 3.0
    simulation.reset(np.arange(2), values, np.zeros(2, np.uint64))
    start = simulation.state()
    start.qpos[:, BALL : BALL + 3] = [0.0, 0.0, 0.67]
    simulation.set_state(np.arange(2), start.qpos, np.zeros_like(start.qvel))
    for _ in range(5):
        assert not simulation.step(None, np.zeros((2, 3))).failed.any()
    light, heavy = simulation.plant.qpos[:, 2]
    assert heavy < light - 0.01
