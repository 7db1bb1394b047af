"""A whole diagnosis that the likelihood decides: files, and kinds of causes in them."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.progress import Moving
from sim2real.diagnosis.data.simulate import Work
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.inference import judge, run, search
from sim2real.diagnosis.inference.fit import Fit, Fitter, Start
from sim2real.diagnosis.inference.run import (
    FEWEST,
    About,
    find_causes,
    find_mistakes,
    spread_windows,
)
from sim2real.diagnosis.inference.screen import Line
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from sim2real.diagnosis.outcome import final_message, write
from tests.sim2real.diagnosis import arm


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_friction_beside_a_late_row_is_told_from_it(tmp_path: Path) -> None:
    """The log's has a remedy; the robot's alone is written as an effect."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), seconds=12.0, noise=3e-4)
    late = {n: np.append(log.columns[n][:1], log.columns[n][:-1]) for n in ("ctrl.a", "ctrl.b")}
    wrong = Log({**log.columns, **late})
    found = run_diagnosis([wrong], arm.model(tmp_path), None, (), 0, None)
    report = found.report
    assert report.failed == ()
    assert report.verdict == "explained"
    kinds = {cause.kind: cause for cause in report.causes}
    assert set(kinds) == {"log", "robot"}
    assert kinds["log"].effect == "row_shift"
    (column,), rows = kinds["log"].extra["columns"], kinds["log"].value
    assert (column, rows) in (("ctrl", 1.0), ("qpos", -1.0))  # late commands are early readings
    assert (kinds["robot"].effect, kinds["robot"].where) == ("coulomb_friction", "b")
    assert kinds["robot"].value == pytest.approx(0.12, rel=0.05)
    remedy = f"{column}.*: put the value of row i{rows:+g} into row i"
    assert any(remedy in words for words in final_message(report))
    write(found, tmp_path / "out")
    effects = yaml.safe_load((tmp_path / "out" / "effects.yaml").read_text())
    assert [one["effect"] for one in effects] == ["coulomb_friction"]
    assert json.loads((tmp_path / "out" / "report.json").read_text())["schema"] == 3
    assert "in the log" in (tmp_path / "out" / "report.html").read_text()


def test_a_first_look_at_more_logs_than_it_takes_windows_finds_their_mistake(
    tmp_path: Path,
) -> None:
    """Some logs then have no window that is looked at."""
    logs = [arm.make_log(seconds=3.0, noise=3e-4, seed=seed) for seed in range(FEWEST + 3)]
    turned = [Log({**log.columns, "ctrl.b": -log.columns["ctrl.b"]}) for log in logs]
    data = Data.of(turned, arm.model(tmp_path))
    few = data.settings.inference
    data = replace(data, settings=replace(data.settings, inference=replace(few, first_s=1.0)))
    assert find_mistakes(data) == ["ctrl.b: multiply by -1"]


def _refuse(*_: object) -> None:
    raise AssertionError("a first look sought this")


def test_a_first_look_at_a_log_without_a_gap_tries_no_mistake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is nothing to mend."""
    monkeypatch.setattr(judge.Judge, "find", _refuse)
    assert find_mistakes(Data.of([arm.make_log(noise=3e-4)], arm.model(tmp_path))) == []


def test_a_first_look_fits_no_mistake_that_cannot_close_the_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Friction is no late row, nor anything else that can be wrong with a log."""
    monkeypatch.setattr(judge.Judge, "find", _refuse)
    log = arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=3e-4)
    assert find_mistakes(Data.of([log], arm.model(tmp_path))) == []


def test_a_first_look_seeks_one_mistake_that_closes_the_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two a diagnosis finds both; what does not explain the gap is compared with nothing."""
    tried = list[str]()
    trace = search.trace_lines

    def look(fitter: Fitter, base: Fit, starts: Sequence[Start]) -> list[Line]:
        tried.extend(start.hypothesis.label for start in starts)
        return trace(fitter, base, starts)

    monkeypatch.setattr(search, "trace_lines", look)
    monkeypatch.setattr(search, "pick_pairs", _refuse)
    monkeypatch.setattr(judge.Judge, "conclude", _refuse)
    log = arm.make_log(("position_gain", {"where": "b"}, 0.4), noise=3e-4)
    assert find_mistakes(Data.of([log], arm.model(tmp_path))) == []
    assert max(Counter(tried).values()) == 2  # a weak gain lags as late rows do: those were fitted


def test_what_is_judged_of_long_logs_is_spread_evenly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A diagnosis takes as long as its setting allows; nothing is left out of shorter logs."""
    data = Data.of([arm.make_log(seconds=40.0, noise=3e-4)], arm.model(tmp_path))
    assert spread_windows(data, data.settings.inference.judged_s) is data
    few = replace(data.settings.inference, judged_s=20.0)
    data = replace(data, settings=replace(data.settings, inference=few))
    judged = list[Data]()
    monkeypatch.setattr(run, "Judge", lambda data, *_: judged.append(data) or _refuse())
    rest = np.random.default_rng(0), Moving(lambda text, share: None), Work()
    with pytest.raises(AssertionError):
        find_causes(About(data, (), (), *rest))
    starts = [window.start for window in data.windows]
    places = np.searchsorted(starts, [w.start for w in judged[0].windows], side="right") - 1
    seconds = sum(np.ptp(window.sample) for window in judged[0].windows)
    assert 15.0 < seconds <= 20.0
    assert [places[0], places[-1]] == [0, len(starts) - 1]
    assert np.ptp(np.diff(places)) <= 1


def test_pushes_are_not_sought_where_the_robot_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are no mistake of the log."""
    monkeypatch.setattr(judge, "find_events", _refuse)
    log = arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=3e-4)
    data = Data.of([log], arm.model(tmp_path))
    first, shifts = judge.Judge(data), ["log.row_shift.ctrl.b", "log.row_shift.qpos.b"]
    tried = first.find(Vocabulary(data, robot=False, only=shifts))
    assert first.conclude(tried).verdict != "explained"
