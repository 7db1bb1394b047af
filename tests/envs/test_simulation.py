"""Rows of simulations: their independence, and what happens to the one that breaks."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from envs.errors import ParameterError, TaskError
from envs.rows import Step
from envs.simulation import Simulation
from envs.tasks import Ant, HalfCheetah, Hopper, Task

SEED = np.array([7], np.uint64)
VALUES = np.array([[5.0, 2.2]])


def simulation(num_rows: int, threads: int = 1, task: Task | None = None) -> Simulation:
    """Return a Hopper whose torso's mass and ground's friction are parameters."""
    foot = "left_ankle_geom" if isinstance(task, Ant) else None
    effects = [make("link_mass", where="torso", how="set"), make("ground_friction", where=foot)]
    return Simulation(task or Hopper(), num_rows, effects, threads)


@pytest.mark.parametrize("steps", [0, -1])
def test_an_episode_without_a_step_is_refused(steps: int) -> None:
    """No task lasts for less than one control step."""
    with pytest.raises(TaskError, match=f"max_steps={steps} must be at least 1"):
        Simulation(Hopper(max_steps=steps))


def start(sim: Simulation, ids: np.ndarray, seed: int = 0) -> np.ndarray:
    """Reset rows with parameters and seeds of their own."""
    rng = np.random.default_rng([seed, *ids])
    values = np.stack([rng.uniform(1, 9, len(ids)), rng.uniform(1.5, 2.5, len(ids))], axis=1)
    return sim.reset(ids, values, rng.integers(0, 2**63, len(ids)).astype(np.uint64))


def controls(steps: int, size: int = 3) -> np.ndarray:
    """Return the actions (steps, A) of the one episode that is repeated in several places."""
    return np.random.default_rng(1).uniform(-1, 1, (steps, size))


def episode(num_rows: int, row: int, threads: int, alone: bool) -> list[np.ndarray]:
    """Run the same 60 steps in a row among others, which step with it or (alone) do not."""
    sim, others = simulation(num_rows, threads), np.random.default_rng(row)
    start(sim, np.arange(num_rows), seed=row)
    one = np.array([row])
    seen = [sim.reset(one, VALUES, SEED)[0]]
    for action in controls(60):
        if alone:
            step, at = sim.step(one, action[None]), 0
        else:
            every = others.uniform(-1, 1, (num_rows, 3))
            every[row] = action
            step, at = sim.step(None, every), row
        seen.append(np.append(step.observation[at], step.reward[at]))
    return seen


@pytest.mark.parametrize(
    ("num_rows", "row", "threads", "alone"),
    [(64, 0, 1, False), (64, 41, 2, False), (64, 63, 2, True), (5, 3, 2, True)],
)
def test_an_episode_does_not_depend_on_its_place(num_rows: int, row: int, threads, alone) -> None:
    """The same parameters, seed and actions give the same bits in any row, batch and threads."""
    for ours, expected in zip(
        episode(num_rows, row, threads, alone), episode(1, 0, 1, False), strict=True
    ):
        np.testing.assert_array_equal(ours, expected)


def test_subsets_step_as_the_whole() -> None:
    """Stepping even and odd rows one after the other equals stepping all at once."""
    whole, parts = simulation(6), simulation(6)
    start(whole, np.arange(6))
    start(parts, np.arange(6))
    for k in range(20):
        action = np.random.default_rng(k).uniform(-1, 1, (6, 3))
        expected = whole.step(None, action)
        for ids in (np.array([0, 2, 4]), np.array([1, 3, 5])):
            step = parts.step(ids, action[ids])
            for ours, theirs in zip(step, expected, strict=True):
                np.testing.assert_array_equal(ours, theirs[ids])


def test_a_reset_leaves_other_rows_alone() -> None:
    """Resetting one row, with other parameters, changes nothing in the rest."""
    plain, disturbed = simulation(4), simulation(4)
    start(plain, np.arange(4))
    start(disturbed, np.arange(4))
    rest = np.array([0, 1, 3])
    for k in range(30):
        action = np.random.default_rng(k).uniform(-1, 1, (4, 3))
        if k % 7 == 3:
            start(disturbed, np.array([2]), seed=k)
        ours, expected = disturbed.step(None, action), plain.step(None, action)
        np.testing.assert_array_equal(ours.observation[rest], expected.observation[rest])
        np.testing.assert_array_equal(ours.reward[rest], expected.reward[rest])


def broken_alike(break_row: object, task: Task | None = None) -> tuple[Step, Step]:
    """Step two simulations of 4 rows, row 1 of the first broken; check the rest, return both."""
    sims = simulation(4, 2, task), simulation(4, 2, task)
    for sim in sims:
        start(sim, np.arange(4))
    size = sims[0].action_size
    action = np.random.default_rng(0).uniform(-1, 1, (4, size))
    broken = action.copy()
    break_row(sims[0], broken)  # type: ignore[operator]
    ours, expected = sims[0].step(None, broken), sims[1].step(None, action)
    rest = np.array([0, 2, 3])
    for _ in range(5):
        for a, b in zip(ours, expected, strict=True):
            np.testing.assert_array_equal(a[rest], b[rest])
        ours_next, expected_next = (
            sims[0].step(rest, action[rest]),
            sims[1].step(rest, action[rest]),
        )
        for a, b in zip(ours_next, expected_next, strict=True):
            np.testing.assert_array_equal(a, b)
    assert not expected.failed.any()
    return ours, expected


def check_failed(step: Step) -> None:
    """Row 1 alone failed, with a reward of 0 and a finite observation."""
    np.testing.assert_array_equal(step.failed, [False, True, False, False])
    assert step.terminated[1]
    assert step.reward[1] == 0.0
    assert np.isfinite(step.observation).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_a_bad_action_fails_its_row(bad: float) -> None:
    """An action that is no number, or absurdly large, ends its row alone."""

    def spoil(sim: Simulation, action: np.ndarray) -> None:
        action[1, 2] = bad

    check_failed(broken_alike(spoil)[0])


@pytest.mark.parametrize("task", [Hopper(), Ant(), Ant(contact_forces="exact")])
@pytest.mark.parametrize("field", ["qpos", "qvel"])
def test_a_diverged_state_fails_its_row(task: Task, field: str) -> None:
    """The engine silently resets a simulation whose state is absurd; its row says so."""

    def spoil(sim: Simulation, action: np.ndarray) -> None:
        getattr(sim.plant, field)[1] = 1e12

    check_failed(broken_alike(spoil, task)[0])


def test_a_row_that_breaks_twice_fails_twice() -> None:
    """A failure is seen again in a row that was not reset after the first one."""
    sim = simulation(4)
    start(sim, np.arange(4))
    for _ in range(3):
        sim.plant.qpos[1] = 1e12
        check_failed(sim.step(None, np.zeros((4, 3))))
    assert not sim.step(None, np.zeros((4, 3))).failed.any()


def test_an_engine_error_fails_its_row() -> None:
    """An error that the engine raises in one simulation ends that row alone."""

    def spoil(sim: Simulation, action: np.ndarray) -> None:
        sim.plant.batch.expand("opt.integrator")[1] = 99

    check_failed(broken_alike(spoil)[0])


def test_failures_are_silent(tmp_path: Path, monkeypatch, capfd) -> None:
    """A diverging row, or a model, writes neither to the terminal nor to MUJOCO_LOG.TXT."""
    monkeypatch.chdir(tmp_path)
    sim = simulation(4, 2)
    start(sim, np.arange(4))
    sim.plant.qpos[1] = 1e12
    check_failed(sim.step(None, np.zeros((4, 3))))
    Simulation(HalfCheetah(), 1)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")


def test_the_time_limit_truncates() -> None:
    """The limit's last step is truncated, each row by its own clock, which a reset restarts."""
    sim = Simulation(HalfCheetah(max_steps=3), 2, threads=1)
    sim.reset(np.arange(2), np.zeros((2, 0)), np.zeros(2, np.uint64))
    action = np.zeros((2, 6))
    sim.step(None, action)
    sim.reset(np.array([1]), np.zeros((1, 0)), SEED)
    flags = [sim.step(None, action).truncated.tolist() for _ in range(3)]
    assert flags == [[False, False], [True, False], [True, True]]


def test_wrong_input_is_refused_before_anything_is_written() -> None:
    """Shapes, states that are not finite and values outside their range are named."""
    sim = simulation(3)
    start(sim, np.arange(3))
    before = sim.plant.batch.state.copy(), sim.plant.params.copy()
    with pytest.raises(TaskError, match=r"action must have shape \(3, 3\), got \(3, 2\)"):
        sim.step(None, np.zeros((3, 2)))
    with pytest.raises(TaskError, match=r"qvel must have shape \(1, 6\)"):
        sim.set_state(np.array([0]), np.zeros((1, 6)), np.zeros((1, 5)))
    with pytest.raises(TaskError, match="qpos holds NaN"):
        sim.set_state(np.array([0]), np.full((1, 6), np.nan), np.zeros((1, 6)))
    with pytest.raises(ParameterError, match=r"link_mass.torso = -1 kg .*outside"):
        sim.reset(np.array([1]), np.array([[-1.0, 2.0]]), SEED)
    np.testing.assert_array_equal(sim.plant.batch.state, before[0])
    np.testing.assert_array_equal(sim.plant.params, before[1])
