"""PG-MAML: rows keep their tasks, it resumes, it adapts on Nav-2D, and what it refuses."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch.nn.utils import parameters_to_vector

from envs.toys import Corners
from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.pg_maml import PGMAML
from sim2real.learning.collectors.by_task import TaskActor, TaskBatch
from sim2real.learning.modules.functional_actor import FunctionalActor
from sim2real.runs.checkpoint import CheckpointStore, restore
from sim2real.runs.errors import CheckpointError, Sim2RealError
from sim2real.verbs import evaluate
from tests.sim2real.trained import make_learner, train

SMALL = ("algorithm.task_batch=3", "adapt.trajectories=4", "algorithm.steps=15")
SMALL += ("env.max_steps=15", "policy.actor.num_cells=[8]", "algorithm.fisher_states=60")


def learner(*words: str, experiment: str = "nav2d_pg") -> PGMAML:
    """Return an untrained PG-MAML of Nav-2D with changes."""
    made = make_learner([f"+experiment={experiment}", *words])
    assert isinstance(made, PGMAML)
    return made


def learned(algorithm: PGMAML, iterations: int) -> tuple[float, float]:
    """Train; return how much adapted policies gained on the first ones, and on unadapted ones.

    All with drawn actions, in the first and the last two iterations.
    """
    logged = [algorithm.iterate() for _ in range(iterations)]
    first, last = (
        np.mean([(x["train/return"], x["train/return_before"]) for x in part], axis=0)
        for part in (logged[:2], logged[-2:])
    )
    return float(last[0] - first[0]), float(last[0] - last[1])


def test_rows_keep_their_task_until_the_next_iteration() -> None:
    """The rows of a task share its goal, before and after adaptation, beyond an episode's end."""
    algorithm = learner(*SMALL, "env.max_steps=5")
    seen = []
    collect = algorithm._collect

    def noted(thetas: torch.Tensor) -> TensorDict:
        seen.append(collect(thetas))
        return seen[-1]

    algorithm._collect = noted  # type: ignore[method-assign, assignment]
    for _ in range(2):
        algorithm.iterate()
    goals = [data["params", "goal.x"] for data in seen]  # (12, 15) each
    for goal in goals:
        by_task = goal.unflatten(0, (3, 4)).flatten(1)
        assert (by_task == by_task[:, :1]).all() and len(by_task[:, 0].unique()) == 3
    assert torch.equal(goals[0], goals[1]) and torch.equal(goals[2], goals[3])
    assert not torch.isin(goals[2], goals[0]).any()
    assert seen[0]["next", "done"].sum(1).min() >= 3  # episodes ended in between


def test_each_task_acts_by_its_own_parameters() -> None:
    """What an actor of tasks does in a row is what that row's actor does alone."""
    algorithm = learner(*SMALL)
    law = FunctionalActor(algorithm.policy.actor)
    actor = TaskActor(law, 3)
    actor.thetas = law.vector() + torch.tensor([[0.0], [0.5], [-0.5]])
    shown = torch.randn(12, 2)
    data = actor(TensorDict({"observation": shown}, [12]))
    for task, theta in enumerate(actor.thetas):
        rows = slice(4 * task, 4 * task + 4)
        loc, log_scale = law(theta, shown[rows])
        torch.testing.assert_close(data["loc"][rows], loc)
        torch.testing.assert_close(data["scale"][rows], log_scale.exp())


@pytest.mark.slow
def test_a_loaded_state_goes_on_to_the_last_bit(tmp_path: Path) -> None:
    """Iterations from a checkpoint equal those of the run that was saved; so for clipped steps."""
    for algorithm in ("pg_maml", "promp"):
        words = (*SMALL, f"algorithm={algorithm}")
        first, second = learner(*words), learner(*words)
        for _ in range(2):
            first.iterate()
        path = CheckpointStore(tmp_path / algorithm, keep_last=1).save(first, 2, {}, 0.0)
        restore(path, second, {})
        for _ in range(2):
            assert first.iterate() == second.iterate()
        vectors = [parameters_to_vector(one.policy.parameters()) for one in (first, second)]
        assert torch.equal(*vectors) and second.iteration == 4


@pytest.mark.slow
@pytest.mark.parametrize("words", [(), ("algorithm.first_order=true",)])
def test_it_learns_to_adapt(words: tuple[str, ...]) -> None:
    """On Nav-2D as published, twenty iterations: twenty episodes bring a point near its goal."""
    since_the_start, by_adapting = learned(learner(*words), 20)
    assert since_the_start > 40 and by_adapting > 30


@pytest.mark.slow
def test_clipped_steps_raise_the_adapted_return() -> None:
    """ProMP's outer step, as published, for twenty iterations: slower than the natural one."""
    since_the_start, by_adapting = learned(learner("algorithm=promp"), 20)
    assert since_the_start > 30 and by_adapting > 0


def test_without_a_direction_it_says_so_and_stays(caplog: pytest.LogCaptureFixture) -> None:
    """Where no action earns more than another nothing moves, and the run goes on."""
    algorithm = learner(*SMALL)
    operator: Any = algorithm.parts.adapt
    whole = type(operator).experience

    def indifferent(self, *given):
        found = whole(self, *given)
        return found._replace(advantage=torch.zeros_like(found.advantage))

    before = parameters_to_vector(algorithm.policy.parameters()).clone()
    with pytest.MonkeyPatch.context() as patch, caplog.at_level(logging.WARNING):
        patch.setattr(type(operator), "experience", indifferent)
        metrics = algorithm.iterate()
    assert "the gradient is zero; the policy is unchanged" in caplog.text
    assert metrics["train/moved"] == 0 and algorithm.iteration == 1
    assert torch.equal(before, parameters_to_vector(algorithm.policy.parameters()))


@pytest.mark.slow
def test_a_checkpoint_is_evaluated_by_its_own_adaptation(tmp_path: Path) -> None:
    """`run=evaluate` scores a grid of goals before and after, also by another operator."""
    words = ["+experiment=nav2d_pg", *SMALL, "iterations=1", "eval=none"]
    run = train(tmp_path / "run", words)
    grid = ["eval=grid_goals", "eval.adaptations=1", "eval.draws=20"]
    grid += ["eval.grid.axes=[{parameter: goal.x, low: -1.0, high: 1.0, count: 2}]"]
    for choice in ([], ["adapt=hillclimb", "adapt.queries=1"], ["adapt=none"]):
        given = ["run=evaluate", f"checkpoint={run}", *grid, *choice]
        out = tmp_path / "_".join(["out", *choice])
        _, arguments = instantiate(compose(given), out)
        scores = evaluate.run(**arguments)
        assert scores.after.shape[-2:] == (2, 1) and np.isfinite(scores.after).all()
        assert (scores.after == scores.before).all() == (choice == ["adapt=none"])


def test_few_tasks_are_drawn_once_each_and_more_are_refused() -> None:
    """A batch of all corners holds each of them; of five it is refused before any work."""
    drawn = TaskBatch(Corners(), 2).sample(np.random.default_rng(0), 8)
    assert len(np.unique(drawn, axis=0)) == 4
    corners = ("env=corners4", "params=corners")
    with pytest.raises(Sim2RealError, match=r"task_batch=20 is more than the 4 tasks of Corners"):
        learner(*corners)
    learner(*corners, *SMALL).iterate()


def test_what_cannot_be_is_refused_in_a_sentence() -> None:
    """Another adaptation, a critic, an optimizer that is not used, counts below 1."""
    with pytest.raises(Sim2RealError, match=r"PGMAML trains for .* PolicyGradient, .* HillClimb"):
        learner("adapt=hillclimb")
    with pytest.raises(Sim2RealError, match=r"only an actor, .*; use policy=actor"):
        learner("policy=actor_critic")
    with pytest.raises(Sim2RealError, match="NaturalStep uses no optimizer"):
        learner("optimizer=adam")
    with pytest.raises(Sim2RealError, match="ClippedSteps needs an optimizer"):
        learner("algorithm=promp", "optimizer=none")
    with pytest.raises(Sim2RealError, match="task_batch=0 must be at least 1"):
        learner("algorithm.task_batch=0")
    with pytest.raises(Sim2RealError, match="fisher_states=5 must be at least 20"):
        learner("algorithm.fisher_states=5")


def test_a_state_of_another_policy_is_refused() -> None:
    """Another network: said, and nothing is taken over."""
    state = learner(*SMALL).state_dict()
    with pytest.raises(CheckpointError, match="its policy is"):
        learner(*SMALL, "policy.actor.num_cells=[9]").load_state_dict(state)
