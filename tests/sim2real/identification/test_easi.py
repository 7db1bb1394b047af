"""Scores of transitions and EASI: a pendulum's length from rollouts that are not aligned."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.distribution import Distribution, Entry
from envs.effects import make
from envs.marginals import uniform
from envs.params import Parameter, ParamSpace
from envs.rows import Step
from hardware.log import Log
from sim2real.identification.data import PolicySimulation, Recordings
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.easi import Easi
from sim2real.identification.methods.matching import Matching
from sim2real.identification.providers.rollout import rollout, transitions
from sim2real.identification.scores.aligned import OneStep
from sim2real.identification.scores.critic import Critic
from sim2real.identification.scores.samples import Embedding, Mmd, SlicedWasserstein
from sim2real.identification.searches import Cma, EasiEs
from sim2real.runs.errors import Sim2RealError

TRUTH, DT, STEPS = 1.2, 0.05, 150
EFFECT = make("payload", where="pole")  # stands for the pendulum's length
PRIOR = Distribution((Entry(EFFECT, (uniform(0.4, 3.6),)),))


class Pendulums:
    """N pendulums of their own lengths, pushed by a noisy policy; each swings for 150 steps."""

    observation_size, action_size, max_steps = 2, 1, STEPS
    action_low, action_high = np.array([-3.0]), np.array([3.0])
    space = ParamSpace([Parameter("payload.pole", "payload", "pole", low=0.1, high=9.0)])

    def __init__(self, num_rows: int) -> None:
        self.num_rows = num_rows
        self._state, self._length = np.zeros((num_rows, 2)), np.ones(num_rows)
        self._age = np.zeros(num_rows)

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Start at small angles."""
        self._length[ids], self._age[ids] = values[:, 0], 0
        starts = [np.random.default_rng(int(seed)).uniform(-0.5, 0.5, 2) for seed in seeds]
        self._state[ids] = np.array(starts)
        return self._state[ids].copy()

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Advance by semi-implicit Euler."""
        angle, speed = self._state.T
        speed = speed + DT * (action[:, 0] - 9.81 * np.sin(angle)) / self._length
        self._state = np.column_stack([angle + DT * speed, speed])
        self._age += 1
        no = np.zeros(self.num_rows, bool)
        return Step(self._state.copy(), no * 1.0, no, self._age >= STEPS, no)


def act(count: int) -> Any:
    """Return a policy with noise, the same numbers each time it is made."""
    rng = np.random.default_rng(5)
    return lambda seen: -0.3 * seen[:, 1:] + rng.normal(0.0, 1.0, (1, 1))


def demonstrations(count: int = 8) -> Log:
    """Return episodes of the true pendulum as a log of what the policy saw and said."""
    rows, policy = Pendulums(count), act(count)
    ids = np.arange(count)
    seen = rows.reset(ids, np.full((count, 1), TRUTH), ids.astype(np.uint64))
    table = []
    for _ in range(STEPS):
        said = policy(seen)
        table.append(np.hstack([seen, said]))
        seen = rows.step(None, said).observation
    every = np.stack(table, axis=1).reshape(count * STEPS, 3)
    columns = {"episode": np.repeat(np.arange(count), STEPS)}
    columns |= {"time": np.tile(DT * np.arange(STEPS), count)}
    columns |= {"ctrl.pole": every[:, 2], "qpos.pole": every[:, 0]}
    columns |= {"obs.0": every[:, 0], "obs.1": every[:, 1], "action.0": every[:, 2]}
    return Log(columns)


DATA = Recordings(
    [demonstrations()], world=PolicySimulation(lambda effects, n: Pendulums(n), act, "Pendulum")
)


@pytest.mark.slow
def test_a_length_is_found_from_rollouts() -> None:
    """From a prior whose middle is 1.67 times the truth, EASI with `critic_gp` comes near it."""
    method = Easi(Critic("gp", batch=800), EasiEs(population=40, generations=20))
    found = method.fit(rollout, PRIOR, DATA)
    assert found.mean == pytest.approx([TRUTH], rel=0.1)
    assert found.std[0] < 0.25
    assert found.entries[0].uncertainty is None  # a population is no posterior


@pytest.mark.slow
def test_distances_of_samples_are_those_of_their_laws() -> None:
    """A shift by 1 along one of five columns is 1 / sqrt(5) along random directions; none is 0."""
    rng, shift = np.random.default_rng(0), np.array([[-1.0], [0.0], [1.0]])
    real = rng.normal(size=(4000, 5))
    simulated = rng.normal(size=(3, 4000, 5))
    simulated[..., 0] += shift
    sliced = SlicedWasserstein(projections=400, compared=4000)(real, simulated)
    assert sliced == pytest.approx([5**-0.5, 0.0, 5**-0.5], abs=0.05)
    left, same, right = Mmd(compared=1000)(real, simulated)
    assert same < 0.1 * min(left, right)


def test_a_score_goes_with_any_search() -> None:
    """CMA-ES finds the length with MMD as well."""
    found = Easi(Mmd(), Cma(population=12, generations=20)).fit(rollout, PRIOR, DATA)
    assert found.mean == pytest.approx([TRUTH], rel=0.15)


def test_the_paper_critic_keeps_its_weights_small() -> None:
    """Its inputs are raw, and every weight stays within the clip and one step."""
    score = Critic("paper", updates=5, batch=300)
    score.begin(2, seed=0)
    made = rollout(DATA, PRIOR.effects)
    score(made.real, made.simulate(np.array([[1.0], [2.0]])))
    weights = [array for name, array in score.state().items() if name.startswith("net.")]
    assert max(np.abs(array).max() for array in weights) < 0.01 + 2 * 3e-3
    seen = score._inputs(made.real, made.real).numpy()
    np.testing.assert_allclose(
        seen[:, -2:], made.real[:, :2] + made.real[:, -2:], rtol=1e-5, atol=1e-6
    )


def test_a_critic_resumes(tmp_path: Path) -> None:
    """A run of six generations equals one of three that goes on for three more."""

    def go(generations: int, name: str, resume: str | None = None) -> Distribution:
        search = EasiEs(population=8, generations=6)
        run = FitContext(0, tmp_path / name, tmp_path / resume if resume else None)
        method = Easi(Critic("gp", updates=3, batch=80), search)
        if generations < 6:
            run = FitContext(0, run.folder, None, _stop_after(generations))
        return method.fit(rollout, PRIOR, DATA, run)

    whole = go(6, "whole")
    with pytest.raises(KeyboardInterrupt):
        go(3, "part")
    resumed = go(6, "resumed", "part")
    np.testing.assert_array_equal(resumed.mean, whole.mean)
    np.testing.assert_array_equal(resumed.std, whole.std)


def _stop_after(generations: int) -> Any:
    def watch(done: int, total: int, best: float | None) -> None:
        if done == generations:
            raise KeyboardInterrupt

    return watch


def test_easi_weights_are_those_of_the_paper() -> None:
    """Log-rank weights of the best half: positive, falling, of sum 1."""
    weights = EasiEs(population=300)._weights()
    wanted = np.log(150.5) - np.log(np.arange(1, 151))
    np.testing.assert_allclose(weights, wanted / wanted.sum())


def test_what_does_not_fit_is_refused() -> None:
    """A score of the other kind, no policy, another task's log, windows that are too long."""
    with pytest.raises(Sim2RealError, match="OneStep compares row by row"):
        Easi(OneStep(), EasiEs())
    with pytest.raises(Sim2RealError, match="Mmd compares transitions"):
        Matching(Mmd(), Cma())
    with pytest.raises(Sim2RealError, match="give checkpoint=RUN"):
        rollout(Recordings(DATA.logs), PRIOR.effects)
    with pytest.raises(Sim2RealError, match=r"2 columns obs\.<i>, but Ant has 60"):
        transitions(DATA.logs[0], (60, 8), "Ant")
    with pytest.raises(Sim2RealError, match=r"provider\.steps=200 is longer than the longest"):
        rollout(DATA, PRIOR.effects, steps=200)
    with pytest.raises(Sim2RealError, match="variant='wgan'"):
        Critic("wgan")  # type: ignore[arg-type]
    with pytest.raises(Sim2RealError, match="features=0 must be at least 1"):
        Embedding(features=0)


def test_embeddings_ask_what_follows_and_not_where_a_robot_comes() -> None:
    """Other starts cost nothing; another law of what follows costs its square."""
    rng = np.random.default_rng(1)

    def world(slope: float, middle: float) -> np.ndarray:
        seen, said = rng.normal(middle, 0.5, (600, 1)), rng.normal(size=(600, 1))
        return np.hstack([seen, said, slope * np.sin(seen) + said])

    real = np.concatenate([world(1.0, 0.0), world(1.0, 1.0)])
    score = Embedding()
    with pytest.raises(Sim2RealError, match="call begin"):
        score(real, real[None])
    score.begin(1, seed=0)
    same, shifted, other = score(
        real, np.stack([world(1.0, 0.5), world(1.0, 1.0), world(2.0, 0.5)])
    )
    assert max(same, shifted) < 1e-3 < 0.05 < other
    moved = np.stack([world(1.0, 0.5), world(1.0, 1.0)])
    left, right = Mmd(compared=600)(real, moved)
    assert right > 3 * left, "a distance of samples sees where the robot was"


@pytest.mark.slow
def test_embeddings_find_the_length() -> None:
    """With CMA-ES, from one episode of each simulation."""
    found = Easi(Embedding(), Cma(population=12, generations=20)).fit(rollout, PRIOR, DATA)
    assert found.mean == pytest.approx([TRUTH], rel=0.05)
