"""Evaluation runs every cell fairly and repeatably, and reports what it ran."""

import json
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.errors import ParameterError
from envs.randomization import Tasks
from envs.toys import BiasedCartPole, Nav2D, NavGoals, ToyEnv
from sim2real.config.compose import compose, instantiate
from sim2real.evaluation.evaluate import Evaluation, find_runs
from sim2real.evaluation.grid import Grid
from sim2real.learning.adapt import Adaptation, HillClimb, NoAdaptation
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.acting import Acting
from sim2real.learning.modules.mlp_policy import MLPPolicy
from sim2real.learning.population.from_trained import population_of
from sim2real.learning.population.population import (
    AdaptationScores,
    Population,
    PopulationRequest,
    draw_seeds,
    evaluate_adaptation,
)
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import make_learner, run_verb

GOALS = Grid(
    [
        {"parameter": "goal.x", "values": [-0.6, 0.0, 0.6]},
        {"parameter": "goal.y", "values": [-0.4, 0.4]},
    ]
)
CLIMB = HillClimb(mode="sequential", queries=4, parallel=1, sigma=0.3)


@dataclass
class Still(Algorithm):
    """The least that can be evaluated: a zero linear policy, which never moves."""

    adapt: Adaptation
    make: Any = Nav2D
    rows: int = 16
    shards: int = 1
    frames: int = 1000
    tasks: Tasks = field(default_factory=NavGoals)
    population: Population = field(init=False)

    def __post_init__(self) -> None:
        shards = [self.make(num_rows=self.rows) for _ in range(self.shards)]
        sizes = (shards[0].observation_size, shards[0].action_size)
        limits = (shards[0].action_low, shards[0].action_high)
        policy = MLPPolicy(
            *sizes, *limits, hidden=(), activation="tanh", output="linear", initial="zero"
        )
        self.population = Population(shards, policy)
        self.theta = np.zeros(policy.num_parameters, np.float32)
        nobody: Any = None  # asks for the policy's maker
        environment = EnvironmentFactory(partial(ToyEnv, self.make), self.tasks)
        self.parts = Components(environment, nobody, 0, self.adapt)

    def scores(self, values: np.ndarray, seeds: np.ndarray, episodes: int) -> AdaptationScores:
        """Return the returns before and after adaptation."""
        return evaluate_adaptation(
            self.population, self.theta, None, self.adapt, values, seeds, episodes
        )

    def trained(self) -> TrainedPolicy:
        """Return the policy, whose episodes `scores` runs."""
        nothing: Any = None
        return TrainedPolicy(
            self.theta, lambda theta: Acting(nothing), self.parts.environment, {}, self.frames
        )

    unused: Any = None
    iterate = shape = state_dict = load_state_dict = unused


def evaluation(grid: Grid = GOALS, **changes: Any) -> Evaluation:
    """Return a small evaluation."""
    options = {"adaptations": 3, "episodes": 2, "threshold": -20.0, "draws": 200}
    return Evaluation(grid, **(options | changes))


def test_a_policy_that_stays_scores_its_distance_in_every_cell() -> None:
    """Nav-2D pays minus the squared distance to the goal, 100 times: the cells are in order."""
    scores = evaluation().assess(Still(NoAdaptation()), 0, "run")
    expected = -100 * (GOALS.cells() ** 2).sum(axis=1)
    assert scores.before.shape == (1, 6, 3)
    np.testing.assert_allclose(scores.before[0], expected[:, None] * np.ones(3))
    np.testing.assert_array_equal(scores.after, scores.before)
    assert (scores.before_sd == 0).all()


def test_hill_climbing_never_loses_where_nothing_is_random() -> None:
    """It accepts only what is better, and its repeats differ by their perturbations."""
    scores = evaluation().assess(Still(CLIMB), 0, "run")
    assert (scores.after >= scores.before).all()
    assert scores.after.mean() > scores.before.mean()
    assert len(np.unique(scores.after[0, 0])) > 1
    assert scores.adaptation_episodes == 5


def test_before_and_after_share_their_luck() -> None:
    """Where starts are random, an adaptation that changes nothing changes no episode's return."""
    grid = Grid([{"parameter": "encoder_offset.pole", "values": [0.0, 0.05]}])
    still = HillClimb(mode="sequential", queries=2, parallel=1, sigma=1e-12)
    scores = evaluation(grid, episodes=5).assess(Still(still, BiasedCartPole), 0, "run")
    np.testing.assert_array_equal(scores.after, scores.before)
    assert (scores.before_sd > 0).any()
    assert len(np.unique(scores.before)) > 2


def test_rows_and_shards_change_no_bit() -> None:
    """Many chunks on few rows, in one thread or in two, give what one batch gives; seeds differ."""
    few, many = Still(CLIMB, rows=2), Still(CLIMB, rows=64)
    two = Still(CLIMB, rows=8, shards=2)
    first, *others = [evaluation().assess(trained, 7, "r") for trained in (few, many, two)]
    for other in others:
        np.testing.assert_array_equal(first.after, other.after)
        assert first.steps == other.steps
    assert (evaluation().assess(many, 8, "r").after != first.after).any()


def test_steps_count_adaptation_and_both_scorings() -> None:
    """Where no episode ends early they are 100 steps for each: 5 to adapt, 2 before and 2 after."""
    tiny = HillClimb(mode="sequential", queries=4, parallel=1, sigma=1e-6)
    far = Grid([{"parameter": "goal.x", "values": [-1.0, 1.0]}], {"goal.y": 1.0})
    scores = evaluation(far).assess(Still(tiny), 0, "run")
    assert scores.steps == (2 * 3 * (5 + 2 + 2) * 100,)


def test_progress_ends_with_all_tasks_done() -> None:
    """The report grows and ends at cells times adaptations."""
    told: list[tuple[int, int]] = []
    evaluation().assess(Still(CLIMB, rows=1), 0, "r", lambda *now: told.append(now))
    assert told[-1] == (18, 18)
    assert told == sorted(told)
    assert len(told) > 1


def test_a_report_is_complete(tmp_path: Path) -> None:
    """Table, cells, picture and description are there and agree with each other."""
    asked = evaluation()
    scores = asked.assess(Still(CLIMB), 0, "seed 0")
    asked.report([scores], 0, tmp_path)
    about = json.loads((tmp_path / "evaluation.json").read_text(encoding="utf-8"))
    assert about["seed"] == 0
    assert about["runs"] == [
        {"name": "seed 0", "training_steps": 1000, "evaluation_steps": scores.steps[0]}
    ]
    gain = next(row for row in about["summary"] if row["policy"] == "gain by adaptation")
    assert gain["mean return"][0] == pytest.approx((scores.after - scores.before).mean())
    assert (tmp_path / "plots" / "heatmaps.png").stat().st_size > 10_000
    assert "gain by adaptation" in (tmp_path / "table.md").read_text(encoding="utf-8")
    assert len((tmp_path / "grid.csv").read_text(encoding="utf-8").splitlines()) == 1 + 6 * 3


@pytest.mark.parametrize(("axes", "pictures"), [(1, ["line.png"]), (3, [])])
def test_pictures_follow_the_number_of_axes(tmp_path: Path, axes: int, pictures: list[str]) -> None:
    """One axis is a line; three axes have a table alone."""
    names = ("goal.x", "goal.y", "return_noise")[:axes]
    grid = Grid([{"parameter": name, "values": [0.5, 1.0]} for name in names])
    from envs.toys import NoisyNav2D

    make = partial(NoisyNav2D, noise="gaussian", scale=1.0)
    asked = evaluation(grid)
    asked.report([asked.assess(Still(CLIMB, make), 0, "run")], 0, tmp_path)
    assert [file.name for file in sorted(tmp_path.glob("plots/*"))] == pictures
    assert (tmp_path / "table.csv").exists()


def test_a_grid_outside_the_space_is_refused_before_any_episode() -> None:
    """The unknown name comes with the known ones."""
    wrong = evaluation(Grid([{"parameter": "goal.z", "values": [0.0, 1.0]}]))
    with pytest.raises(ParameterError, match=r"no parameter 'goal\.z'.*goal\.x, goal\.y"):
        wrong.assess(Still(CLIMB), 0, "run")


def test_a_grid_is_checked_before_training() -> None:
    """An axis of no parameter of the policy's robots is named with those that there are."""
    wrong = evaluation(grid=Grid([{"parameter": "foo", "low": 0.0, "high": 1.0, "count": 2}]))
    with pytest.raises(ValueError, match=r"no parameter 'foo'; choose one of: goal\.x"):
        wrong.check(Still(NoAdaptation()))
    evaluation().check(Still(NoAdaptation()))


def test_impossible_numbers_are_refused() -> None:
    """Counts start at 1 and a box has its low end below its high end."""
    with pytest.raises(Sim2RealError, match=r"eval\.episodes=0 must be at least 1"):
        evaluation(episodes=0)
    with pytest.raises(Sim2RealError, match=r"eval\.box\.goal\.x: low=1\.0 is above high=0\.0"):
        evaluation(box={"goal.x": (1.0, 0.0)})


def test_a_box_that_is_given_replaces_the_training_range() -> None:
    """It decides what counts as inside; parameters without an axis drop out of it."""
    box = {"goal.x": (-0.1, 0.7), "elsewhere": (0.0, 1.0)}
    scores = evaluation(box=box).assess(Still(NoAdaptation()), 0, "run")
    assert scores.box == {"goal.x": (-0.1, 0.7)}
    assert scores.regions()["inside the training range"].sum() == 4


def test_runs_are_found_in_folders_and_sweeps(tmp_path: Path) -> None:
    """A sweep's folder stands for its runs, each named by its seed, newest checkpoint each."""
    for number in range(2):
        folder = tmp_path / str(number)
        (folder / "checkpoints").mkdir(parents=True)
        for iteration in (10, 20):
            (folder / "checkpoints" / f"checkpoint-{iteration:08d}.torchrl").touch()
        (folder / "manifest.json").write_text(json.dumps({"seed": number + 5}), encoding="utf-8")
    found = find_runs(tmp_path)
    assert list(found) == ["seed 5", "seed 6"]
    assert [file.name for file in found.values()] == ["checkpoint-00000020.torchrl"] * 2
    assert find_runs([tmp_path / "0", tmp_path / "1"]) == found
    assert len(find_runs([tmp_path / "0", tmp_path / "0"])) == 1


def test_nothing_to_evaluate_is_refused(tmp_path: Path) -> None:
    """No checkpoint, a path that is not there, and a folder without one."""
    with pytest.raises(Sim2RealError, match="give checkpoint=PATH"):
        find_runs(None)
    with pytest.raises(Sim2RealError, match="does not exist"):
        find_runs(tmp_path / "missing")
    with pytest.raises(Sim2RealError, match="contains no checkpoint"):
        find_runs(tmp_path)


def test_the_verb_puts_trained_runs_into_one_table(tmp_path: Path) -> None:
    """Two seeds of a sweep, trained and loaded by their folder, are two rows of the interval."""
    small = ["algorithm.pairs=2", "algorithm.num_rows=16", "adapt.queries=2"]
    for seed in (3, 4):
        own = [f"seed={seed}", "iterations=1", "eval=none"]
        out = tmp_path / "sweep" / str(seed)
        learner = run_verb(["+experiment=nav2d", *small, *own], out)
        (out / "manifest.json").write_text(json.dumps({"seed": seed}), encoding="utf-8")
    again = ["run=evaluate", f"checkpoint={tmp_path / 'sweep'}", "eval.adaptations=1"]
    verb, arguments = instantiate(compose(["+experiment=nav2d", *small, *again]), tmp_path / "out")
    scores = verb(**arguments)
    assert scores.runs == ("seed 3", "seed 4")
    assert scores.frames[1] == learner.frames
    assert (scores.after[0] != scores.after[1]).any()
    np.testing.assert_array_equal(
        scores.after[1:], arguments["eval"].assess(learner, 0, "seed 4").after
    )
    assert "bootstrap over 2 training runs" in (tmp_path / "out" / "table.md").read_text("utf-8")


def test_all_runs_are_checked_before_the_first_is_evaluated(tmp_path: Path, monkeypatch) -> None:
    """A run of another task among them is refused at once, whatever its place."""
    small = ["algorithm.pairs=2", "algorithm.num_rows=16", "adapt.queries=2", "policy=linear"]
    for name in ("nav2d", "corners4"):
        own = [f"+experiment={name}", "iterations=1", "eval=none"]
        run_verb([*small, *own], tmp_path / name)
    again = ["run=evaluate", f"checkpoint=[{tmp_path / 'nav2d'},{tmp_path / 'corners4'}]"]
    monkeypatch.setattr(Evaluation, "assess", lambda *_: pytest.fail("the first was evaluated"))
    with pytest.raises(Sim2RealError, match="corners4"):
        run_verb(["+experiment=nav2d", *small, *again], tmp_path / "out")


def test_a_policy_that_does_not_adapt_is_scored_in_every_cell(tmp_path: Path) -> None:
    """An untrained PPO policy, near 0 everywhere: each goal's score is that of standing still."""
    words = ["env=nav2d", "params=goals", "algorithm=ppo", "eval=grid_goals"]
    learner = make_learner(words, tmp_path)
    scores = evaluation(episodes=3, adaptations=2).assess(learner, 0, "run")
    still = evaluation(episodes=3, adaptations=2).assess(Still(NoAdaptation()), 0, "run")
    assert scores.adaptation_episodes == 0 and scores.after.shape == (1, 6, 2)
    np.testing.assert_array_equal(scores.before, scores.after)
    np.testing.assert_allclose(scores.after, still.after, rtol=0.2)
    assert scores.steps[0] == 6 * 2 * 3 * 100


@pytest.mark.parametrize("trainer", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_every_operator_adapts_every_policy(trainer: str, tmp_path: Path) -> None:
    """The actor of PPO and of SAC is a vector, too; the same seed adapts it alike."""
    words = ["env=nav2d", "env.max_steps=20", "params=goals", f"algorithm={trainer}"]
    words.append("policy.actor.num_cells=[16]")
    learner = make_learner(words, tmp_path)
    asked = evaluation(episodes=1, adaptations=1)
    for name in ("hillclimb", "average", "batch", "gradient"):
        adapt = instantiate(compose([*words, f"adapt={name}"]), tmp_path)[1]["parts"].adapt
        adapt.sigma = adapt.rate = 0.3
        learner.parts = replace(learner.parts, adapt=adapt)
        first = asked.assess(learner, 0, "run")
        assert first.adaptation_episodes == adapt.episodes > 0
        assert np.any(first.after != first.before), name
        assert name == "gradient" or np.all(first.after >= first.before)  # nothing is random
    again = asked.assess(learner, 0, "run")
    np.testing.assert_array_equal(first.after, again.after)


def test_a_policy_in_a_population_gets_what_it_gets_alone(tmp_path: Path) -> None:
    """The same parameters under the same seeds, transforms with frozen statistics included."""
    words = ["env=hopper", "params=mass_friction", "algorithm=ppo", "algorithm.num_rows=4"]
    words += ["algorithm.steps=64", "env.task.max_steps=60"]
    learner = make_learner(words, tmp_path)
    learner.iterate()
    trained = learner.trained()
    values = np.array([[1.0, 2.0], [4.0, 1.5], [8.0, 2.5]])
    seeds = draw_seeds(np.random.default_rng(0), (3, 2))
    population = population_of(trained, 3)
    cohort = NoAdaptation().start_many(
        np.tile(trained.theta, (3, 1)), [np.random.default_rng(0)] * 3
    )
    found = population.run(PopulationRequest(cohort, values, values, seeds), None)
    alone = trained.run_episodes(seeds.ravel(), values=np.repeat(values, 2, axis=0))
    np.testing.assert_allclose(found.returns.ravel(), alone.returns, rtol=1e-4)
    np.testing.assert_array_equal(found.lengths.ravel(), alone.lengths)


def test_ppo_adapts_what_ppo_trained_by_its_critic(tmp_path: Path) -> None:
    """Every robot's actor changes; rewards count as the critic learned them; the same seed again.

    The training's rewards were scaled, and those of the evaluation are not.
    """
    words = ["env=nav2d", "env.max_steps=20", "params=goals", "algorithm=ppo"]
    words += ["policy.actor.num_cells=[16]", "adapt.rounds=2", "adapt.steps=30", "adapt=ppo"]
    learner = make_learner([*words, "run=evaluate", "checkpoint=none"], tmp_path, adapts=False)
    learner.iterate()
    critic = learner.trained().critic
    assert critic is not None and critic.unit != 1.0
    asked = evaluation(episodes=1, adaptations=1)
    first, again = (asked.assess(learner, 0, "run") for _ in range(2))
    assert first.adaptation_episodes == 2 and (first.after != first.before).mean() > 0.9
    np.testing.assert_array_equal(first.after, again.after)
