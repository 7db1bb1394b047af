"""Fits of hypotheses on the arm of the tests: values, sensitivities, held-out scores."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.candidates import Candidate, candidates
from sim2real.diagnosis.inference.distance import Distance, compute_separation
from sim2real.diagnosis.inference.fit import Fitter, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.moves import restart
from sim2real.diagnosis.inference.replayer import Job, Replayer
from sim2real.diagnosis.inference.score import Bootstrap, deal_folds
from tests.sim2real.diagnosis import arm

NONE = Hypothesis(())
FRICTION, DELAY, NOISE = 0.12, 0.012, 3e-4


class Case(NamedTuple):
    """A log's windows, and what fits them."""

    data: Data
    replayer: Replayer
    fitter: Fitter
    options: dict[str, Candidate]


def case_of(log: Log, folder: pytest.TempPathFactory) -> Case:
    """Return a log with a likelihood that knows the noise alone."""
    data = arm.data_of(log, folder.mktemp("arm"))
    replayer = Replayer(data)
    none = np.zeros((*replayer.used.shape, 2, 0))
    likelihood = Likelihood(
        replayer.times, replayer.used, replayer.noise, none, none, replayer.settings
    )
    fitter = Fitter(replayer, likelihood, deal_folds(data.windows))
    return Case(data, replayer, fitter, {c.label: c for c in candidates(data)})


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Return the arm with dry friction and a late command."""
    effects = ("coulomb_friction", {"where": "b"}, FRICTION), ("command_delay", {}, DELAY)
    return case_of(arm.make_log(*effects, noise=NOISE), tmp_path_factory)


def test_two_values_are_found_together(case: Case) -> None:
    """Friction and delay from starts that are off, each fold by itself."""
    members = case.options["coulomb_friction.b"], case.options["command_delay"]
    start = Start(Hypothesis(members), np.array([[0.05, 0.02], [0.2, 0.004]]))
    (fit,) = case.fitter.fit([start])
    np.testing.assert_allclose(fit.values, [[FRICTION, DELAY]] * 2, rtol=0.03)
    np.testing.assert_allclose(np.std(fit.held[case.replayer.used]), NOISE, rtol=0.15)
    (given,) = case.fitter.fit([Start(NONE, np.zeros((1, 0)))])
    assert fit.total > given.total + 1000


def test_slopes_in_longer_steps_lead_to_the_same_values(case: Case) -> None:
    """They say where to go; what decides is replayed in the model's own steps."""
    coarse = case.replayer.coarsen(case.replayer.every)
    steps = [one.data.models[0].opt.timestep for one in (case.replayer, coarse)]
    assert steps[1] > steps[0]
    other = Fitter(case.replayer, case.fitter.likelihood, case.fitter.fold, coarse)
    members = case.options["coulomb_friction.b"], case.options["command_delay"]
    start = Start(Hypothesis(members), np.array([[0.05, 0.02]]))
    one, two = (fitter.fit([start])[0] for fitter in (case.fitter, other))
    np.testing.assert_allclose(two.values, one.values, rtol=0.01)
    assert two.density.sum() == pytest.approx(one.density.sum(), abs=1.0)  # nats


def test_a_wave_is_found_from_no_wave_at_all(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Its phase says nothing there; its cosine and its sine part do."""
    wave = "encoder_eccentricity", {"where": "b", "phase": -2.1}, 0.15
    case = case_of(arm.make_log(wave, noise=NOISE), tmp_path_factory)
    members = (case.options["encoder_eccentricity.b"],)
    (fit,) = case.fitter.fit([Start(Hypothesis(members), np.array([[0.0, np.pi / 2]]))])
    found = fit.mean[0] * np.exp(1j * fit.mean[1])
    assert abs(found - 0.15 * np.exp(-2.1j)) < 0.01


def test_whole_numbers_go_on_while_that_is_better(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Commands are logged four rows late; the fit begins at two."""
    log, rows = arm.make_log(seconds=8.0, noise=NOISE), 4
    late = np.concatenate([np.full(rows, log.columns["ctrl.b"][0]), log.columns["ctrl.b"][:-rows]])
    case = case_of(Log({**log.columns, "ctrl.b": late}), tmp_path_factory)
    (shift,) = (c for c in list_log_changes(case.data) if c.label == "log.row_shift.ctrl.b")
    (fit,) = case.fitter.fit([Start(Hypothesis((shift,)), shift.probes)])
    assert fit.values.tolist() == [[rows], [rows]] and rows > shift.probes.max()


@pytest.mark.parametrize("punch", [0.0, 1.0])
def test_an_edge_is_found_where_no_slope_leads(
    punch: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """A servo hunts about the edge of a wide dead zone: steps nearby and the other shape do."""
    hidden = "dead_zone", {"where": "b", "punch": punch}, 0.3
    case = case_of(arm.make_log(hidden, noise=NOISE), tmp_path_factory)
    start = Start(Hypothesis((case.options["dead_zone.b"],)), np.array([[0.39, 1 - punch]]))
    (fit,) = case.fitter.fit([start])
    np.testing.assert_allclose(fit.values, [[0.3, punch]] * 2, rtol=0.01)


def test_a_fit_that_cannot_reach_the_best_at_its_pace_goes_no_further(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is not stepped as often as the one that goes on, which is what it is by itself."""
    stepped: list[str] = []
    own = Fitter._step

    def step(fitter: Fitter, states: list) -> list:
        stepped.extend(state.hypothesis.label for state in states)
        return own(fitter, states)

    monkeypatch.setattr(Fitter, "_step", step)
    labels = "coulomb_friction.b", "viscous_friction.b"
    both = case.options[labels[0]], case.options["command_delay"]
    good = Start(Hypothesis(both), np.array([[0.02, 0.05]]))
    poor = Start(Hypothesis((case.options["viscous_friction.a"],)), np.array([[1e-3]]))
    (alone,) = case.fitter.fit([good])
    stepped.clear()
    fits = case.fitter.fit([good, poor])
    counts = [stepped.count(start.hypothesis.label) for start in (good, poor)]
    assert 1 <= counts[1] < counts[0]
    np.testing.assert_allclose(fits[0].values, alone.values)


def test_a_fit_whose_step_went_too_far_is_given_a_shorter_one(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Errors are linear in 1 / scale: the first step of a scale that is to be halved ends at 0."""
    log, scale = arm.make_log(seconds=8.0, noise=NOISE), 0.25
    scaled = {name: scale * v for name, v in log.columns.items() if name.startswith("ctrl.")}
    case = case_of(Log({**log.columns, **scaled}), tmp_path_factory)
    (change,) = (c for c in list_log_changes(case.data) if c.label == "log.scale.ctrl")
    starts = [Start(Hypothesis((change,)), np.array([[v]])) for v in (2 * scale, scale)]
    for fit in case.fitter.fit(starts):
        np.testing.assert_allclose(fit.values, scale, rtol=0.01)


def test_the_score_is_of_held_out_windows(case: Case) -> None:
    """It is that of each window under the values and the discrepancy of the other fold."""
    start = Start(Hypothesis((case.options["coulomb_friction.b"],)), np.array([[0.1]]))
    (fit,) = case.fitter.fit([start], rounds=1)
    window = int(np.flatnonzero(case.fitter.fold == 1)[0])
    job = Job(fit.hypothesis, fit.values[:1], np.array([window]))
    (alone,) = case.replayer.replay([job])
    np.testing.assert_allclose(alone.error[0], fit.held[window], atol=1e-12)
    projection = case.fitter.likelihood.project(fit.held)
    expected = case.fitter.likelihood.predict(projection, fit.trained[0])[window]
    assert fit.score[window] == pytest.approx(expected)


def test_errors_that_are_known_are_judged_as_a_fit_is(case: Case) -> None:
    """Nothing is replayed again, and where nothing else is known nothing changes."""
    start = Start(Hypothesis((case.options["command_delay"],)), np.array([[0.01]]))
    (fit,) = case.fitter.fit([start])
    (fit,) = case.fitter.fit([restart(fit)], rounds=0)
    same = case.fitter.judge(fit.hypothesis, fit.values, (fit.own, fit.held))
    np.testing.assert_allclose(same.score, fit.score, rtol=1e-9)
    np.testing.assert_allclose(same.density, fit.density, rtol=1e-9)


def test_a_start_changes_what_replays_of_moved_starts_say(case: Case) -> None:
    """Sensitivities to positions, by finite differences, begin at one standard deviation."""
    replayer = case.replayer
    ways = replayer.starts(NONE, np.zeros((len(replayer.every), 0)))
    assert ways.shape == (*replayer.used.shape, 2, 4)
    early = replayer.times[:, 0].argmin()  # the window without a warm-up
    first = ways[early, 0]
    np.testing.assert_allclose(first[0, 0], replayer.noise[0], rtol=0.05)
    np.testing.assert_allclose(first[1, 1], replayer.noise[1], rtol=0.05)
    assert abs(first[0, 1]) < 0.1 * replayer.noise[1]


def test_mending_a_reversed_log_gives_the_errors_of_the_right_one(
    case: Case, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Commands, starts and readings of a mended log are those of a log without the mistake."""
    log = case.data.logs[0]
    turned = {name: -log.columns[name] for name in ("qpos.b", "ctrl.b")}
    wrong = case_of(Log({**log.columns, **turned}), tmp_path_factory)
    change = next(c for c in list_log_changes(wrong.data) if c.label == "log.reversal.ctrl.qpos.b")
    every = case.replayer.every
    rows = (slice(None), 0)  # windows may be cut at other rows: the first episode's start is not
    job = Job(Hypothesis((change,)), np.zeros((len(every), 0)), every)
    (mended,) = wrong.replayer.replay([job])
    (right,) = case.replayer.replay([Job(NONE, np.zeros((len(every), 0)), every)])
    np.testing.assert_allclose(mended.error[0][rows], right.error[0][rows], atol=1e-9)
    assert np.abs(mended.error).max() == pytest.approx(np.abs(right.error).max(), rel=0.3)


def test_effects_that_act_alike_are_not_separated(case: Case) -> None:
    """A late command and a late reading predict the same; friction does not."""
    labels = "command_delay", "observation_delay", "coulomb_friction.b"
    starts = [Start(Hypothesis((case.options[label],)), np.array([[0.01]])) for label in labels]
    late, read, other = case.fitter.fit(starts, rounds=2)
    near, far = (compute_separation(case.fitter, late, one) for one in (read, other))
    assert 0 <= near < far / 10
    assert compute_separation(case.fitter, late, late) == 0
    windows, rng = case.data.windows, np.random.default_rng(0)
    bootstrap = Bootstrap(windows, rng, case.replayer.settings)
    distance = Distance(case.fitter, bootstrap, np.ones(len(case.data.joints)))
    assert distance.distinguishes(late, other)
    assert not distance.distinguishes(late, late)


def test_a_step_corrects_the_slopes_by_what_it_changed(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Finite differences are taken once, and again where the corrected slopes lead no further."""
    asked: list[int] = []
    own = Fitter._differentiate

    def differentiate(fitter: Fitter, states: list) -> None:
        asked.append(len(states))
        own(fitter, states)

    monkeypatch.setattr(Fitter, "_differentiate", differentiate)
    members = case.options["coulomb_friction.b"], case.options["command_delay"]
    (fit,) = case.fitter.fit([Start(Hypothesis(members), np.array([[0.05, 0.02]]))])
    steps = zip(asked[::2], asked[1::2], strict=True)  # of each: at first, and anew
    assert asked[0] == 1 and (0, 0) in steps
    np.testing.assert_allclose(fit.values, [[FRICTION, DELAY]] * 2, rtol=0.03)


def test_a_step_that_promises_no_gain_is_not_taken(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a fit has ended there is nothing to gain, as its slopes show without a replay."""
    tried: list[float] = []
    own = Fitter._improve

    def improve(fitter: Fitter, state: Any, other: Any) -> bool:
        more = own(fitter, state, other)
        tried.append(state.gain.max())
        return more

    monkeypatch.setattr(Fitter, "_improve", improve)
    members = case.options["coulomb_friction.b"], case.options["command_delay"]
    start = Start(Hypothesis(members), np.array([[0.05, 0.02]]))
    (fit,) = case.fitter.fit([start])
    assert len(tried) > 1 and max(tried) > 100.0  # nats
    tried.clear()
    (again,) = case.fitter.fit([Start(fit.hypothesis, fit.values[None])])
    assert not tried
    np.testing.assert_array_equal(again.values, fit.values)


def test_corrected_slopes_say_how_errors_changed(case: Case) -> None:
    """Broyden's condition: along the step they are the secant, across it what they were."""
    members = case.options["coulomb_friction.b"], case.options["command_delay"]
    (state,) = case.fitter._begin([Start(Hypothesis(members), np.array([[0.05, 0.02]]))])
    case.fitter._differentiate([state])
    before, rng = state.slopes.copy(), np.random.default_rng(0)
    size = state.hypothesis.size
    step = size * np.array([[0.3, -0.2], [0.1, 0.4]])
    across = size * np.array([[0.2, 0.3], [-0.4, 0.1]])  # orthogonal, each in its own size
    change = rng.normal(size=state.replay.error.shape)
    state.learn(step, change, case.fitter.fold)
    per_window = step[case.fitter.fold], across[case.fitter.fold]
    along, other = (np.einsum("wnmp,wp->wnm", state.slopes, own) for own in per_window)
    np.testing.assert_allclose(along, change, atol=1e-9)
    np.testing.assert_allclose(other, np.einsum("wnmp,wp->wnm", before, per_window[1]), atol=1e-9)
