"""Trajectory matching: truths with their intervals, spread apart from uncertainty, flat directions.

The emulated robot's servo, friction and bus follow laws of their own; the linear system is known in
closed form.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from envs.distribution import Distribution, Entry
from envs.distribution_file import NINETY
from envs.effects import make
from envs.marginals import uniform
from envs.randomization import Draw, Randomization
from hardware.config import ROBOTS
from hardware.log import Log, read_logs
from sim2real.config.compose import compose
from sim2real.diagnosis.data.recording import load_model
from sim2real.identification.data import Recordings
from sim2real.identification.identify import identify
from sim2real.identification.local import autocorrelation_time
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.matching import Matching
from sim2real.identification.outcome import warnings
from sim2real.identification.providers.replay import replay
from sim2real.identification.providers.steps import states
from sim2real.identification.random_effects import random_effects, shrink_correlations
from sim2real.identification.scores.aligned import KStep, Likelihood, OneStep
from sim2real.identification.searches import Cma
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs import record
from tests.sim2real.identification.linear import PRIOR, Linear

QUICK = Cma(population=6, generations=12)

SLIDE = """
<mujoco><option timestep="0.01" gravity="0 0 0"/>
<worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0" damping="DAMPING"/>
<geom size="0.1" mass="1"/></body></worldbody>
<actuator><motor name="x" joint="x" gear="1"/></actuator></mujoco>
"""


def slide(folder: Path, mass: float, gain: float, seed: int, damping: float = 0.0) -> Log:
    """Return a cart's log with its state, in closed form: each row its speed grows by f / m dt."""
    (folder / "slide.xml").write_text(SLIDE.replace("DAMPING", str(damping)), encoding="utf-8")
    rng, rows = np.random.default_rng(seed), 120
    force = rng.normal(size=rows)
    speed, place = np.zeros(rows), np.zeros(rows)
    for i in range(rows - 1):  # semi-implicit Euler, damping implicitly, as the model's integrator
        grown = speed[i] + 0.01 * gain * force[i] / mass
        speed[i + 1] = grown / (1 + 0.01 * damping / mass)
        place[i + 1] = place[i] + 0.01 * speed[i + 1]
    columns = {"episode": np.zeros(rows), "time": 0.01 * np.arange(rows)}
    columns |= {"ctrl.x": force, "qpos.x": place, "qvel.x": speed}
    return Log(columns, {"model": str(folder / "slide.xml")}, folder / f"{seed}.csv")


def test_rows_that_cannot_be_compared_one_by_one_are_refused(tmp_path: Path) -> None:
    """A servo that is off for a row; what the message says to choose is accepted."""
    log = slide(tmp_path, mass=1.0, gain=1.0, seed=0)
    off = {"torque.x": np.r_[np.ones(len(log) - 1), 0.0]}
    log = replace(log, columns={**log.columns, **off})
    with pytest.raises(Sim2RealError, match="servos that are switched off") as refused:
        states(log, load_model(log, None).compile(), rows=1)
    words = str(refused.value).rpartition("; use ")[2].split(" with ")
    assert compose(["run=identify", *words])["identify"]["score"]["rows"] is None


def scaled(name: str, where: str, low: float = 0.3, high: float = 3.0) -> Entry:
    """Return a prior of a factor."""
    return Entry(make(name, where=where, how="scale"), (uniform(low, high),))


def truths(found: Distribution, truth: list[float]) -> bool:
    """Return whether every 90 % interval of a mean holds the truth."""
    return bool((np.abs(found.mean - truth) <= NINETY * found.columns("uncertainty")).all())


@pytest.mark.slow
def test_intervals_of_a_linear_system_hold_the_truth_nine_times_in_ten() -> None:
    """120 systems of six episodes with a spread: means are covered, and spreads are unbiased."""
    rng, held, spreads = np.random.default_rng(0), [], []
    spread = np.array([0.5, 0.1])
    for _ in range(120):
        values = np.array([1.0, -2.0]) + spread * rng.normal(size=(6, 2))
        provider = Linear(values, 0.3, rng)
        found = Matching(KStep(), Cma(generations=2)).found(provider, PRIOR, FitContext())
        off = np.abs(found.mean - [1.0, -2.0])
        held.append(off <= NINETY * found.columns("uncertainty"))
        spreads.append(found.columns("spread") ** 2)
    assert np.mean(held, axis=0) == pytest.approx([0.9, 0.9], abs=0.08)
    assert np.sqrt(np.mean(spreads, axis=0)) == pytest.approx(spread, rel=0.2)


@pytest.mark.slow
def test_draws_of_six_robots_hold_a_seventh_nine_times_in_ten() -> None:
    """150 systems: few robots tell their spread badly, and draws are wider for it."""
    rng, held = np.random.default_rng(2), []
    spread = np.array([0.5, 0.2])
    for _ in range(150):
        values = np.array([1.0, -2.0]) + spread * rng.normal(size=(7, 2))
        provider = Linear(values[:6], 0.1, rng)
        found = Matching(KStep(), Cma(generations=2)).found(provider, PRIOR, FitContext())
        draws = found.sample(rng, 1000)
        low, high = np.quantile(draws, [0.05, 0.95], axis=0)
        held.append((low <= values[6]) & (values[6] <= high))
        assert (found.std >= 1.2 * found.columns("spread")).all()
    assert np.mean(held, axis=0) == pytest.approx([0.9, 0.9], abs=0.06)


def test_one_robot_has_no_spread() -> None:
    """Where all episodes have the same values, the spread found is far below the uncertainty."""
    rng = np.random.default_rng(1)
    found = Matching(KStep(), QUICK).found(Linear(np.ones((12, 2)), 0.3, rng), PRIOR, FitContext())
    assert (found.columns("spread") < 0.06).all()  # an episode alone knows 0.05
    assert (found.std < 0.1).all()
    assert (np.abs(found.mean - 1.0) < 3 * found.columns("uncertainty")).all()


def test_one_episode_says_so() -> None:
    """Of one episode the spread is not known, which is not the same as none."""
    found = Matching(KStep(), QUICK).found(
        Linear(np.ones((1, 2)), 0.3, np.random.default_rng(1)), PRIOR, FitContext()
    )
    assert found.entries[0].spread is None
    assert np.isfinite(found.columns("uncertainty")).all()


def test_few_episodes_hang_together_by_chance() -> None:
    """Correlations of six independent robots go down, those of 600 that are there stay."""
    rng = np.random.default_rng(0)
    before, after = [], []
    for _ in range(100):
        own = np.cov(rng.normal(size=(6, 4)).T)
        small = shrink_correlations(own, 6)
        np.testing.assert_allclose(np.diag(small), np.diag(own))
        assert np.linalg.eigvalsh(small)[0] > 0
        before.append(_most(own))
        after.append(_most(small))
    assert np.mean(before) > 0.65 and np.mean(after) < 0.35
    true = np.cov(rng.multivariate_normal([0, 0], [[1e-10, 0.8e-5], [0.8e-5, 1.0]], 600).T)
    assert _most(true) == pytest.approx(0.8, abs=0.05)
    np.testing.assert_allclose(shrink_correlations(true, 600), true, rtol=0.005)


def _most(covariance: np.ndarray) -> float:
    """Return the largest correlation, either way."""
    deviations = np.sqrt(np.diag(covariance))
    return float(
        np.abs(covariance / np.outer(deviations, deviations) - np.eye(len(deviations))).max()
    )


def test_the_split_of_a_meta_analysis() -> None:
    """Exact estimates leave all scatter to the spread; those that are all noise leave it none."""
    rng = np.random.default_rng(0)
    true = rng.multivariate_normal([1.0, 2.0], [[0.25, 0.2], [0.2, 0.25]], 400)
    exact = random_effects(true, np.tile(1e-8 * np.eye(2), (400, 1, 1)))
    np.testing.assert_allclose(exact.spread, np.cov(true.T), rtol=1e-3)
    noise = random_effects(true, np.tile(np.cov(true.T) * 1.3, (400, 1, 1)))
    assert np.trace(noise.spread) < 0.05
    np.testing.assert_allclose(noise.uncertainty, np.cov(true.T) * 1.3 / 400, rtol=0.2)


def test_errors_that_hang_together_count_less() -> None:
    """The integrated autocorrelation time of an AR(1) series is (1 + r) / (1 - r)."""
    rng, series = np.random.default_rng(0), np.zeros((1, 40000, 1))
    for i in range(1, 40000):
        series[0, i] = 0.6 * series[0, i - 1] + rng.normal()
    assert autocorrelation_time(series) == pytest.approx([4.0], rel=0.15)
    assert autocorrelation_time(rng.normal(size=(1, 40000, 1))) == pytest.approx([1.0], abs=0.1)


@pytest.mark.slow
def test_mass_and_gain_are_flat_together(tmp_path: Path) -> None:
    """A cart in free space shows the quotient alone: it is found, and the direction is named."""
    data = Recordings([slide(tmp_path, 1.5, 1.2, seed) for seed in range(2)])
    prior = Distribution((scaled("link_mass", "cart"), scaled("motor_strength", "x")))
    found = Matching(OneStep(), Cma(generations=60)).fit(replay, prior, data)
    mass, gain = found.mean
    assert gain / mass == pytest.approx(1.2 / 1.5, rel=0.01)
    (flat,) = found.flat
    assert set(flat.parameters) == {"link_mass.cart", "motor_strength.x"}
    assert min(flat.parameters.values()) > 0.3  # both grow together
    assert flat.known < 0.1
    assert found.joint is not None and found.joint[0, 1] > 0.99  # draws keep the quotient
    drawn = found.sample(np.random.default_rng(0), 500)
    assert drawn[:, 0].std() > 0.2
    inside = ((drawn > prior.low + 0.01) & (drawn < prior.high - 0.01)).all(axis=1)
    assert (drawn[inside, 1] / drawn[inside, 0]).std() < 0.1


@pytest.mark.slow
def test_a_damper_parts_mass_and_gain(tmp_path: Path) -> None:
    """With a known damper both are seen, and nothing is flat."""
    data = Recordings([slide(tmp_path, 1.5, 1.2, seed, damping=2.0) for seed in range(2)])
    prior = Distribution((scaled("link_mass", "cart"), scaled("motor_strength", "x")))
    found = Matching(OneStep(), Cma(generations=60)).fit(replay, prior, data)
    assert found.flat == ()
    assert found.mean == pytest.approx([1.5, 1.2], rel=0.01)


@pytest.mark.slow
def test_two_robots_are_found_as_spread(tmp_path: Path) -> None:
    """Carts of 1.2 and 1.8 kg: the spread is theirs, ten times the uncertainty of one alone."""
    logs = [slide(tmp_path, mass, 1.0, seed) for seed, mass in enumerate((1.2, 1.8) * 3)]
    prior = Distribution((scaled("link_mass", "cart"),))
    one = Matching(OneStep(), QUICK).fit(replay, prior, Recordings(logs[::2]))
    both = Matching(OneStep(), QUICK).fit(replay, prior, Recordings(logs))
    assert both.mean == pytest.approx([1.5], abs=0.1)
    assert both.columns("spread") == pytest.approx([0.33], abs=0.08)
    assert one.columns("spread")[0] < 0.03


@pytest.mark.parametrize("score", [KStep(rows=5), Likelihood(rows=5)], ids=["k_step", "likelihood"])
def test_scores_find_the_mass(tmp_path: Path, score: KStep) -> None:
    """Five rows on from each state as well as one, by square errors and by likelihood."""
    data = Recordings([slide(tmp_path, 1.5, 1.0, seed) for seed in range(2)])
    prior = Distribution((scaled("link_mass", "cart"),))
    outcome = identify(data, Matching(score, QUICK), prior)
    assert outcome.found.mean == pytest.approx([1.5], rel=0.01)
    assert outcome.judged is not None
    assert outcome.judged.after < 0.05 * outcome.judged.before


def test_a_mean_at_the_border_is_said(tmp_path: Path) -> None:
    """The truth lies beyond the prior: the warning has the parameter's name."""
    data = Recordings([slide(tmp_path, 2.5, 1.0, 0)])
    prior = Distribution((scaled("link_mass", "cart", 0.5, 1.5),))
    outcome = identify(data, Matching(OneStep(), QUICK), prior)
    (words,) = warnings(outcome)
    assert "link_mass.cart" in words and "upper end" in words and "widen the prior" in words


@pytest.mark.slow
def test_hidden_friction_and_load_of_an_emulated_robot(tmp_path: Path) -> None:
    """Both are within their 90 % intervals, which are narrow beside the prior."""
    hidden = tmp_path / "hidden.yaml"
    hidden.write_text(
        "- {effect: coulomb_friction, where: hinge, value: 0.03}\n"
        "- {effect: payload, where: arm, value: 0.05}\n",
        encoding="utf-8",
    )
    robot = yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8"))
    for seed in range(2):
        record.run(
            robot=robot | {"hidden": str(hidden)},
            port=None,
            calibration=None,
            arm=False,
            motions=["ramp", "steps", "multisine"],
            seconds=4.0,
            stops=None,
            leader=None,
            leader_port=None,
            leader_calibration=None,
            leader_scale=[],
            size=0.6,
            seed=seed,
            out=tmp_path / f"log{seed}",
        )
    data = Recordings(read_logs([str(tmp_path / f"log{seed}" / "log.csv") for seed in range(2)]))
    prior = Randomization(
        [
            Draw(make("coulomb_friction", where="hinge"), low=0.0, high=0.1),
            Draw(make("payload", where="arm"), low=0.0, high=0.2),
        ]
    )
    outcome = identify(data, Matching(KStep(), Cma(generations=12)), prior)
    assert truths(outcome.found, [0.03, 0.05]), outcome.found.mean
    assert (outcome.found.columns("uncertainty") < [0.004, 0.006]).all()
    assert outcome.judged is not None
    assert outcome.judged.after < 0.1 * outcome.judged.before
    assert 0.8 <= outcome.judged.coverage <= 0.99
