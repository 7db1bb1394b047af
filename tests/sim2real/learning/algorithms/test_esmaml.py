"""ES-MAML: it learns to adapt, counts its steps, resumes bit for bit, and obeys its options."""

import io
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from envs.effects import make
from envs.errors import ParameterError
from envs.mujoco import MujocoEnv
from envs.randomization import Draw, Randomization
from envs.tasks.base import Task
from envs.tasks.hopper import Hopper
from envs.toys import AngleBias, BiasedCartPole, Nav2D, NavGoals, NoisyNav2D, ToyEnv
from sim2real.learning.adapt import Adaptation, GradientAdaptation, HillClimb, NoAdaptation
from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.esmaml import ESMAML, ESMAMLSettings
from sim2real.learning.algorithms.shards import make_shards
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.mlp_policy import mlp_policy
from sim2real.learning.population.population import evaluate_adaptation

LINEAR = partial(mlp_policy, hidden=(), activation="tanh", output="linear", initial="zero")
HIDDEN = partial(mlp_policy, hidden=(8,), activation="tanh", output="tanh", initial="normal")
CLIMB = HillClimb(mode="sequential", queries=20, parallel=1, sigma=0.1)
GRADIENT = GradientAdaptation(queries=20, sigma=0.1, rate=0.05, baseline="mean")
OPTIONS: dict[str, Any] = {
    "num_rows": 256, "shards": 1, "refill": 64, "pairs": 50, "sigma": 0.1, "learning_rate": 0.02,
    "optimizer": "sgd", "estimator": "antithetic", "shaping": "standardized", "top_k": 0,
    "orthogonal": False, "weight_decay": 0.0, "paired_tasks": True, "tasks_per_member": 1,
    "final_episodes": 1, "step_cost": 0.0, "normalize_observations": False,
    "meta_estimator": "zeroth_order", "first_order_queries": 30, "clean_final": (),
}  # fmt: skip
QUICK = HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1)
SMALL = {
    "pairs": 4, "num_rows": 6, "refill": 1, "normalize_observations": True, "optimizer": "adam",
}  # fmt: skip


def made(env: Any, tasks: Any, policy: Any, adapt: Adaptation, seed: int, **options: Any) -> ESMAML:
    """Return the algorithm in a world: a toy, or a task of the simulator."""
    simulated = isinstance(env, Task)
    base: partial[Any] = partial(MujocoEnv, task=env) if simulated else partial(ToyEnv, env)
    return ESMAML(
        Components(EnvironmentFactory(base, tasks), policy, seed, adapt), ESMAMLSettings(**options)
    )


def make_nav(adapt: Adaptation, seed: int = 0, **changes: Any) -> ESMAML:
    """ES-MAML on Nav-2D."""
    return made(Nav2D, NavGoals(), LINEAR, adapt, seed, **(OPTIONS | changes))


def make_cartpole(adapt: Adaptation = QUICK, seed: int = 0, **changes: Any) -> ESMAML:
    """A small ES-MAML on CartPole."""
    return made(BiasedCartPole, AngleBias(), HIDDEN, adapt, seed, **(OPTIONS | SMALL | changes))


def score(algorithm: ESMAML, tasks: int = 60) -> tuple[float, float]:
    """Mean return before and after adaptation over Nav-2D tasks."""
    rng = np.random.default_rng(1234)
    values = NavGoals().sample(rng, tasks)
    seeds = rng.integers(0, 2**63, tasks, dtype=np.uint64)
    scores = evaluate_adaptation(
        algorithm.population,
        algorithm.theta,
        algorithm.normalizer,
        algorithm.adapt,
        values,
        seeds,
        1,
    )
    return float(scores.before.mean()), float(scores.after.mean())


@pytest.mark.slow
def test_hill_climbing_beats_the_gradient_beats_no_adaptation() -> None:
    """After a short training on Nav-2D, K = 20, adapted returns order as published."""
    scores = {}
    for name, adapt in (("none", NoAdaptation()), ("gradient", GRADIENT), ("climb", CLIMB)):
        algorithm = make_nav(adapt, pairs=40, num_rows=80, refill=25)
        for _ in range(10):
            algorithm.iterate()
        scores[name] = score(algorithm)[1]
    assert scores["climb"] > scores["gradient"] + 5
    assert scores["gradient"] > scores["none"] + 10


@pytest.mark.slow
def test_first_order_learns_to_adapt() -> None:
    """The first-order variant improves what a gradient step reaches on Nav-2D."""
    algorithm = make_nav(
        GRADIENT, meta_estimator="first_order", pairs=20, first_order_queries=60, learning_rate=0.1
    )
    untrained = score(algorithm)[1]
    for _ in range(12):
        algorithm.iterate()
    assert score(algorithm)[1] > untrained + 3


@pytest.mark.parametrize("between", [{}, {"num_rows": 3}, {"num_rows": 9, "shards": 2}])
def test_resumes_bit_for_bit(between: dict) -> None:
    """A run loaded into another, also with other rows and shards, goes on with the same numbers."""
    one = make_cartpole()
    for _ in range(2):
        one.iterate()
    buffer = io.BytesIO()
    torch.save(one.state_dict(), buffer)
    buffer.seek(0)
    other = make_cartpole(seed=77, **between)
    other.load_state_dict(torch.load(buffer, weights_only=True))
    for _ in range(2):
        assert one.iterate() == other.iterate()
    np.testing.assert_array_equal(one.theta, other.theta)
    assert one.normalizer is not None
    assert other.normalizer is not None
    np.testing.assert_array_equal(one.normalizer.std, other.normalizer.std)
    assert one.frames == other.frames > 0


def make_hopper(**changes: Any) -> ESMAML:
    """ES-MAML on a few short Hopper episodes with randomized physics."""
    draws = [
        Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0),
        Draw(make("ground_friction"), low=1.5, high=2.5),
    ]
    options = {**OPTIONS, **SMALL, "pairs": 3, **changes}
    return made(Hopper(max_steps=15), Randomization(draws), HIDDEN, QUICK, 0, **options)


def test_physics_runs_the_same_on_any_rows_and_shards() -> None:
    """On MuJoCo with randomized physics, one row and two shards give the same bits."""
    runs = [make_hopper(), make_hopper(num_rows=1), make_hopper(num_rows=7, shards=2)]
    metrics = [[run.iterate() for _ in range(2)] for run in runs]
    assert metrics[0] == metrics[1] == metrics[2]
    for run in runs[1:]:
        np.testing.assert_array_equal(run.theta, runs[0].theta)


def test_same_seed_same_run_other_seed_other_run() -> None:
    """The seed decides everything."""
    runs = [make_cartpole(seed=seed) for seed in (1, 1, 2)]
    metrics = [run.iterate() for run in runs]
    assert metrics[0] == metrics[1] != metrics[2]


def test_counts_every_environment_step() -> None:
    """Frames are the steps that the environments were asked for, adaptation included."""
    steps = []

    class Counting(BiasedCartPole):
        def step(self, ids, action):
            steps.append(len(action))
            return super().step(ids, action)

    algorithm = made(Counting, AngleBias(), HIDDEN, QUICK, 0, **(OPTIONS | SMALL))
    algorithm.iterate()
    assert algorithm.frames == sum(steps)


def test_warm_up_scores_candidates_as_they_are() -> None:
    """Until so many steps it is evolution without adaptation, to the bit; then it adapts."""
    warm, plain = make_cartpole(warm_up=1), make_cartpole(NoAdaptation())
    first = warm.iterate()
    assert first == plain.iterate()
    np.testing.assert_array_equal(warm.theta, plain.theta)
    assert first["train/return"] == first["train/return_before"]
    before = warm.frames
    warm.iterate()
    plain.iterate()
    assert warm.frames - before > 2 * (plain.frames - before)  # three episodes each, and one more
    with pytest.raises(ValueError, match="warm_up=-1 must not be negative"):
        make_cartpole(warm_up=-1)


@pytest.mark.parametrize(("paired", "equal"), [(True, True), (False, False)])
def test_pairs_share_task_and_luck_if_asked(paired: bool, equal: bool) -> None:
    """With one candidate on both sides of a pair, paired members return the same bits."""
    algorithm = make_cartpole(paired_tasks=paired, tasks_per_member=3)
    candidates = np.tile(algorithm.theta, (8 * 3, 1))
    results = algorithm._run(QUICK, candidates, algorithm._draws(8))
    plus, minus = results.returns[:12], results.returns[12:]
    assert np.array_equal(plus, minus) == equal
    assert len(np.unique(plus[:, 0])) > 3


def test_forward_differences_share_one_draw() -> None:
    """With forward differences and paired tasks every member meets the same tasks."""
    algorithm = make_cartpole(estimator="forward_fd", tasks_per_member=2)
    np.testing.assert_array_equal(algorithm._draws(5), np.tile([0, 1], 5))
    assert algorithm.iterate()["train/frames"] > 0


def test_final_episodes_can_be_free_of_noise() -> None:
    """With `clean_final` the score is of exact returns while adaptation sees noisy ones."""
    env = partial(NoisyNav2D, noise="gaussian", scale=1e6)
    algorithm = made(
        env, NavGoals(1.0), LINEAR, QUICK, 0, **{**OPTIONS, "clean_final": ["return_noise"]}
    )
    metrics = algorithm.iterate()
    assert abs(metrics["train/return"]) < 1e3 < abs(metrics["train/return_before"])


def test_torch_module_carries_the_normalizer() -> None:
    """The policy as a torch module acts as the population's rows do on the same raw observation."""
    algorithm = make_cartpole()
    algorithm.iterate()
    observation = np.random.default_rng(0).normal(size=(5, 4))
    slots = algorithm.policy.slots(5)
    slots.load(np.arange(5), np.tile(algorithm.theta, (5, 1)))
    assert algorithm.normalizer is not None
    normalized = (observation - algorithm.normalizer.mean) / algorithm.normalizer.std
    with torch.no_grad():
        program = algorithm.trained().program
        assert program is not None
        action = program(algorithm.theta)(torch.from_numpy(observation))
    np.testing.assert_allclose(action.numpy(), slots.act(None, normalized), atol=1e-4)


def test_checkpoints_of_other_policies_are_refused() -> None:
    """A state of another task, or with other normalization, is an error that says what differs."""
    state = make_cartpole().state_dict()
    with pytest.raises(ValueError, match="'observation_size': 4"):
        make_nav(CLIMB).load_state_dict(state)
    with pytest.raises(ValueError, match="normalize_observations"):
        make_cartpole(normalize_observations=False).load_state_dict(state)


def test_bad_input_is_refused() -> None:
    """Wrong tasks, names and numbers are refused before anything runs."""
    with pytest.raises(ParameterError, match="encoder_offset"):
        made(Nav2D, AngleBias(), LINEAR, CLIMB, 0, **OPTIONS)
    with pytest.raises(ParameterError, match="return_noise"):
        make_nav(CLIMB, clean_final=["return_noise"])
    with pytest.raises(ValueError, match="final_episodes=0"):
        make_nav(CLIMB, final_episodes=0)
    with pytest.raises(ValueError, match="gradient adaptation"):
        make_nav(CLIMB, meta_estimator="first_order")
    with pytest.raises(ValueError, match="shards=3"):
        make_shards(EnvironmentFactory(partial(ToyEnv, Nav2D), NavGoals()), 2, 3)
