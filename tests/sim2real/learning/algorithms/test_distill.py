"""RMA's student: what it sees, that it learns, and that a resumed training is the same."""

from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.distill import Distill
from sim2real.learning.student import EstimateContext
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import make_learner

WORDS = ["env=hopper", "params=mass_friction", "policy=mlp", "env.task.max_steps=30"]
SMALL = ["algorithm.num_rows=4", "algorithm.shards=1", "algorithm.pairs=2"]
SETTINGS = {"num_rows": 6, "history": 4, "hidden": (16,), "learning_rate": 0.01}


def teacher(*words: str) -> tuple[TrainedPolicy, Components]:
    """Return a policy that was not trained, and its parts."""
    made = make_learner([*WORDS, *SMALL, *words])
    return made.trained(), made.parts


@pytest.fixture(scope="module")
def made() -> tuple[TrainedPolicy, Components]:
    """Return a policy that is told mass and friction."""
    return teacher("transforms=with_params")


def learner(made: tuple[TrainedPolicy, Components], epochs: int = 4) -> Distill:
    """Return what trains a student of it."""
    trained, parts = made
    return Distill(parts, teacher=lambda: trained, epochs=epochs, batch_size=32, **SETTINGS)


@pytest.mark.slow
def test_the_student_learns_which_robot_it_is(made: tuple[TrainedPolicy, Components]) -> None:
    """Its guesses come nearer to the truth than the middle of the ranges does."""
    one = learner(made)
    losses = [one.iterate()["train/loss"] for _ in range(16)]
    trained, told = one.trained(), made[0].context
    assert told is not None
    robots = np.array([[1.5, 1.6], [8.5, 2.4], [2.5, 2.4], [7.5, 1.6]])
    env = trained.make_env(4, threads=1)
    now = env.reset(values=robots, seeds=np.arange(4, dtype=np.uint64))
    actor = trained.actor(trained.theta)
    with torch.no_grad():
        for _ in range(10):
            now = env.step_and_maybe_reset(actor(now))[1]
    said = now["observation"][:, 11:].numpy()
    truth = told.normalize(robots, 1.0)
    off = np.abs(said - truth)[:, 0].mean()  # the mass; friction shows only where the foot slips
    assert off < 0.6 * np.abs(truth)[:, 0].mean()
    assert losses[-1] < losses[0]


def test_a_robot_s_pilot_guesses_as_the_simulation_does(made) -> None:
    """The same steps make the same guesses; an episode forgets the one before."""
    one = learner(made, epochs=1)
    one.iterate()
    trained = one.trained()
    env, pilot = trained.make_env(2, threads=1), trained.controller(num_rows=2)
    actor: Any = trained.actor(trained.theta)
    for _ in range(2):
        now = env.reset(values=np.array([[2.0, 2.0], [8.0, 2.0]]), seeds=np.ones(2, np.uint64))
        pilot.reset()
        with torch.no_grad():
            for _ in range(6):
                raw: Any = env.base_env._last
                acted = actor(now)
                np.testing.assert_allclose(pilot(raw), acted["action"], atol=1e-5)
                now = env.step_and_maybe_reset(acted)[1]


def test_rows_that_start_again_forget_alone(made: tuple[TrainedPolicy, Components]) -> None:
    """A row's history begins with its episode; those of its neighbours go on."""
    trained = learner(made).trained()
    env = trained.make_env(2, threads=1)
    chain: Any = env.transform
    (guess,) = [t for t in chain if isinstance(t, EstimateContext)]
    now = env.reset()
    for _ in range(3):
        now = env.step_and_maybe_reset(trained.actor(trained.theta)(now))[1]
    before = guess.past.clone()
    env.reset(now.set("_reset", torch.tensor([[True], [False]])))
    assert guess.past[0, :-1].isnan().all() and guess.past[0, -1].isfinite().all()
    torch.testing.assert_close(guess.past[1], before[1])


def test_a_resumed_training_is_the_same(made: tuple[TrainedPolicy, Components]) -> None:
    """All that the next iteration depends on is in the state."""
    first, other = learner(made), learner(made)
    first.iterate()
    other.load_state_dict(first.state_dict())
    assert first.iterate() == other.iterate()
    for a, b in zip(first.student.parameters(), other.student.parameters(), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)


def test_a_teacher_that_is_told_nothing_is_refused() -> None:
    """There is nothing to guess then; and a student has a step to see."""
    with pytest.raises(Sim2RealError, match="receives no parameters"):
        learner(teacher())
    told = teacher("transforms=with_params")
    with pytest.raises(Sim2RealError, match="history=0"):
        partial(Distill, told[1], teacher=lambda: told[0], epochs=1, batch_size=8)(
            **{**SETTINGS, "history": 0}
        )
