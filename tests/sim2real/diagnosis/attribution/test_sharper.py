"""What causes leave where the simulator takes no shortcuts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.plant import Plant
from envs.replay import rollout
from hardware.log import Log
from sim2real.diagnosis.attribution.attribute import Contender, Search
from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.conclude import conclude
from sim2real.diagnosis.attribution.fit import Fit, refine
from sim2real.diagnosis.attribution.judge import Judge
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.sharper import RULE, SHORTCUTS, bristles, sharper, told
from sim2real.diagnosis.attribution.usual import Usual
from sim2real.diagnosis.attribution.verdict import verdict_of
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.report import text
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis import pendulum

FINEST, COUNT = 2.5e-4, 2 * np.pi / 4096  # s, rad
MORE = 0.08  # N·m of dry friction that the model lacks
BENDS = ("stribeck_friction", {"where": "pivot", "bristle": 1e-3, "ratio": 0.5}, 1e-6)


def log_of(*effects: tuple[str, dict, float], seconds: float = 12.0) -> Log:
    """Return a log of the pendulum in the finest steps, read in counts."""
    spec = mujoco.MjSpec.from_string(pendulum.XML)
    spec.option.timestep = FINEST
    time = np.arange(round(seconds * pendulum.RATE)) / pendulum.RATE
    wanted = 0.5 * np.sin(2 * np.pi * (0.3 * time + 0.08 * time**2))[:, None]
    plant = Plant(spec, [make(n, **a) for n, a, _ in effects], 1, 1)
    plant.set_params(np.zeros(1, int), np.array([[value for *_, value in effects]]))
    start, per = np.zeros((1, 1)), round(1 / pendulum.RATE / FINEST)
    plant.reset(np.zeros(1, int), start, start, np.zeros(1, np.uint64), wanted[:1], measured=True)
    path = rollout(plant, wanted.repeat(per, axis=0)[None])[0, :-1:per]
    read = COUNT * np.round(path[:, 0] / COUNT)
    columns = {"episode": np.zeros(len(time)), "time": time}
    return Log({**columns, "ctrl.pivot": wanted[:, 0], "qpos.pivot": read})


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Search:
    """Return a search on a robot with more dry friction, all of which gives way by 1 mrad."""
    log = log_of(("coulomb_friction", {"where": "pivot"}, MORE), BENDS)
    one_bend = replace(DEFAULT, numerics=replace(DEFAULT.numerics, bends=(1e-3,)))
    data = Data.of([log], pendulum.model(tmp_path_factory.mktemp("pendulum")), one_bend)
    names = ("coulomb_friction.pivot", "viscous_friction.pivot", "stribeck_friction.pivot")
    options = [option for option in candidates(data) if option.label in names]
    problem, floors = Problem(data, Simulator(data, threads=1)), data.floors()
    rng = np.random.default_rng(0)
    return Search(problem, options, float(floors[0]), rng, lambda text, share: None, floors)


def fitted(search: Search, name: str, start: Sequence[float]) -> tuple[Judge, Fit, np.ndarray]:
    """Return a cause with its values and held-out errors."""
    member = _option(search, name)
    fit = refine(search.fitting, (member,), np.array([start]))
    error = search.problem.held_out(fit.members, fit.values)
    return Judge(search, fit.members, search.problem.data.floors(), True), fit, error


def _option(search: Search, name: str) -> Candidate:
    return next(option for option in search.options if option.name == name)


@pytest.mark.slow
def test_a_right_cause_explains_what_the_shortcuts_hide(search: Search) -> None:
    """What it leaves as given is the time step's and the rigid friction's; so is its value's error.

    It is told, with the value that it has there.
    """
    judge, fit, error = fitted(search, "coulomb_friction", [0.05])
    given = judge.rest(search.base, error)
    sharp = sharper(judge, fit, given, [])
    assert verdict_of(given, search.problem.data) == "partly_explained"
    assert sharp is not None
    assert sharp.rest.after < 0.4 * given.after
    assert given.closed == pytest.approx(0.71, abs=0.01)
    assert sharp.rest.closed == pytest.approx(0.99, abs=0.01)
    assert sharp.bend == 1e-3 and sharp.step == pytest.approx(pendulum.STEP / 4)
    assert fit.mean[0] == pytest.approx(1.11 * MORE, rel=0.01)
    assert sharp.fit.mean[0] == pytest.approx(0.99 * MORE, rel=0.01)
    finding = told(sharp, given.after, "rad")
    assert finding.check == SHORTCUTS
    assert f"coulomb_friction.pivot {sharp.fit.mean[0]:.3g}" in finding.finding
    assert "0.25 ms" in finding.finding and "0.001 rad" in finding.finding
    assert "0.001 m before" in told(sharp, given.after, "m").finding
    assert "bristle=0.001" in finding.fix


@pytest.mark.slow
def test_a_verdict_says_so_unless_usual_errors_make_as_much(
    search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gap stays that of the model as given; a cause not wholly clear explains a part."""
    monkeypatch.setattr(search, "options", [_option(search, "coulomb_friction")])
    found, floors = search.run(), search.problem.data.floors()
    some = {1.0: "explained", 0.9: "partly_explained", 0.0: "partly_explained"}
    for clear, verdict in some.items():
        monkeypatch.setattr(Usual, "clear", lambda *_, clear=clear: clear)
        report = conclude(search, found, floors, np.random.default_rng(0)).report
        assert [cause.effect for cause in report.causes] == ["coulomb_friction"]
        assert report.verdict == verdict
        assert report.gap.closed is not None and report.gap.closed < 0.9
        told_so = [finding for finding in report.preflight if finding.check == SHORTCUTS]
        assert len(told_so) == (verdict == "explained")
        assert ("the simulator's own" in text.details(report)) == bool(told_so)


@pytest.mark.slow
def test_a_contender_that_explains_there_as_well_contests_it(search: Search) -> None:
    """What shortcuts hid they may have hidden of another cause; one that stays wrong is none."""
    judge, fit, error = fitted(search, "coulomb_friction", [0.05])
    given = judge.rest(search.base, error)
    _, wrong, _ = fitted(search, "viscous_friction", [0.05])
    as_good = fit  # as another law that moves it alike would be
    assert sharper(judge, fit, given, [wrong]) is not None
    assert sharper(judge, fit, given, [wrong, as_good]) is None


def test_contenders_that_a_report_does_not_name_are_asked(
    search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that leaves more than the cause is no equivalent; it stands in the cause's place."""
    _, wrong, _ = fitted(search, "viscous_friction", [0.05])
    monkeypatch.setattr(search, "options", [_option(search, "coulomb_friction")])
    monkeypatch.setattr(Usual, "clear", lambda *_: 1.0)
    asked: list[Sequence[Fit]] = []
    monkeypatch.setattr(
        "sim2real.diagnosis.attribution.conclude.sharper",
        lambda judge, fit, given, others: asked.append(others),
    )
    far = Contender(wrong.members[0], wrong, search.base)
    own = search.run()
    found = replace(own, rivals={own.fit.members[0].label: [far]})
    report = conclude(search, found, search.problem.data.floors(), np.random.default_rng(0)).report
    ((other,),) = asked
    assert report.verdict == "partly_explained" and report.causes[0].equivalent == ()
    assert other.members == wrong.members
    assert np.array_equal(other.values, wrong.values)


def test_a_wrong_cause_stays_wrong(search: Search) -> None:
    """Viscous friction closes as much as given, and no more where nothing excuses it."""
    judge, fit, error = fitted(search, "viscous_friction", [0.05])
    given = judge.rest(search.base, error)
    assert given.closed == pytest.approx(0.57, abs=0.01)
    assert sharper(judge, fit, given, []) is None


def test_nobody_looks_where_it_cannot_help(search: Search, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cause that closes little stays one, and so does one that lacks its witness."""
    judge, fit, error = fitted(search, "coulomb_friction", [0.05])
    given, ran = judge.rest(search.base, error), []
    monkeypatch.setattr(Simulator, "run_each", lambda *_: ran.append(1))
    assert sharper(judge, fit, given._replace(closed=0.4), []) is None
    assert sharper(judge, fit, given._replace(witnessed=False), []) is None
    assert ran == []


def test_a_joint_whose_bristles_are_a_cause_keeps_them(
    search: Search, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An effect is at a place once, whether it is named or matched."""
    judge, _, _ = fitted(search, "coulomb_friction", [0.05])
    ((effect, values),) = bristles(judge, 2e-3)
    assert (effect.name, effect.where) == ("stribeck_friction", "pivot")
    assert effect.extra["bristle"] == 2e-3 and values[0] < 1e-5
    own = judge._replace(members=(_option(search, "stribeck_friction"),))
    assert list(bristles(own, 2e-3)) == []
    monkeypatch.setattr(search.problem.simulator, "fixed", ((make(RULE, where="piv*"), (0.1,)),))
    assert list(bristles(judge, 2e-3)) == []
