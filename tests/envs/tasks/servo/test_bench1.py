"""Bench1: what it observes, and that the robot's limits hold in both fidelities."""

import numpy as np
import pytest

from envs.errors import TaskError
from envs.simulation import Simulation
from envs.tasks import Bench1
from envs.tasks.base import CommandState
from envs.tasks.servo.base import Fidelity


def track(fidelity: Fidelity, lead: float = 0.0) -> tuple[float, np.ndarray]:
    """Return the return of an episode under a constant action, and its observations (T, O)."""
    sim = Simulation(Bench1(fidelity, seconds=3.0), 1, threads=1)
    seen = [sim.reset(np.arange(1), sim.space.points(1), np.array([3], np.uint64))[0]]
    total = 0.0
    for _ in range(sim.max_steps):
        step = sim.step(None, np.array([[lead]]))
        total += float(step.reward[0])
        seen.append(step.observation[0])
    return total, np.array(seen)


def test_the_real_servo_lags_more() -> None:
    """A proportional servo with back-EMF follows worse than the stiff ideal one."""
    ideal, _ = track("ideal")
    servo, _ = track("servo")
    assert servo < 1.3 * ideal < 0


def test_an_observation_is_what_the_servo_says() -> None:
    """Angle in counts, the reference now and next, and the last action."""
    task = Bench1("servo")
    _, seen = track("servo", lead=0.1)
    counts = seen[:, 0] / (2 * np.pi / 4096)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    np.testing.assert_allclose(seen[1:, 2], seen[:-1, 3])
    np.testing.assert_allclose(seen[:, 2], task.reference(np.arange(151) * 0.02)[0])
    np.testing.assert_array_equal(seen[:, 5], [0.0, *[0.1] * 150])


def test_the_reference_has_the_speed_that_it_says() -> None:
    """The reference's speed is its derivative."""
    task, time = Bench1(), np.linspace(0.01, 4.0, 57)
    _, speed = task.reference(time)
    slope = (task.reference(time + 1e-6)[0] - task.reference(time - 1e-6)[0]) / 2e-6
    away = np.abs(time - 1.0) > 1e-3
    np.testing.assert_allclose(speed[away], slope[away], atol=1e-5)


def test_goals_stay_within_the_robots_limits() -> None:
    """No goal leaves the range or moves faster than the robot can; all are whole counts."""
    task = Bench1("servo")
    last = np.array([[1.9], [0.0]])
    state = task.state_from_measurement(
        last, 0 * last, CommandState(np.full(2, 1.3), 0 * last, last)
    )
    goal = task.command(state, np.array([[9.0], [-9.0]]))
    count = 2 * np.pi / 4096
    np.testing.assert_allclose(goal[:, 0], [2.0, -8.0 / 50], atol=count / 2)
    np.testing.assert_allclose(goal / count, np.round(goal / count), atol=1e-9)


def test_measurements_give_what_the_simulation_gives() -> None:
    """Observation and reward of a state made of measurements equal those of the simulated state."""
    sim = Simulation(Bench1("ideal"), 3, threads=1)
    task, rng = sim.task, np.random.default_rng(0)
    assert isinstance(task, Bench1)
    sim.reset(np.arange(3), sim.space.points(3), np.arange(3, dtype=np.uint64))
    for _ in range(20):
        action = rng.uniform(-0.5, 0.5, (3, 1))
        before = sim.state()
        step = sim.step(None, action)
    after = sim.state()
    assert after.command is not None
    made = task.state_from_measurement(
        after.qpos, after.qvel, after.command, torque=task.torque(after)
    )
    np.testing.assert_array_equal(task.observe(made), step.observation)
    np.testing.assert_array_equal(task.reward(before, made, action, step.terminated), step.reward)
    np.testing.assert_allclose(task.power(made), task.power(after))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"fidelity": "serv"}, "servo"),
        ({"robot": "bench"}, "bench1"),
        ({"robot": "arm6"}, "hinge"),
        ({"robot": {"name": "mine", "servos": {"hinge": {}}}}, "mine"),
        ({"seconds": 0.001}, "control step"),
    ],
)
def test_a_wrong_argument_is_refused(arguments: dict, words: str) -> None:
    """A sentence says what is wrong, and what is near."""
    with pytest.raises(TaskError, match=words):
        Bench1(**arguments)
