"""What promises most, along straight lines in the likelihood's metric."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.moves import (
    are_compatible,
    join_members,
    list_simpler,
    restart,
)
from sim2real.diagnosis.inference.score import FOLDS
from sim2real.diagnosis.inference.screen import (
    Line,
    list_closing,
    list_promising,
    pick_alike,
    pick_closest,
    pick_pairs,
    pick_starts,
    trace_lines,
)
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from tests.sim2real.diagnosis import arm

NOISE = 3e-4
LABELS = (
    "coulomb_friction.a",
    "coulomb_friction.b",
    "viscous_friction.b",
    "position_gain.a",
    "position_gain.b",
    "log.row_shift.ctrl.b",
)


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> tuple[Judge, list[Line]]:
    """Return the judge of an arm whose second joint rubs, and the lines of a few changes."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=NOISE)
    data = arm.data_of(log, tmp_path_factory.mktemp("arm"))
    judge = Judge(data)
    starts = Vocabulary(data, only=LABELS).list_starts(judge.replay_errors(judge.given), "ab")
    (base,) = judge.search.glance.fit([restart(judge.given)], rounds=0)
    return judge, trace_lines(judge.search.glance, base, starts)


def test_the_true_change_promises_most_at_about_its_value(
    traced: tuple[Judge, list[Line]],
) -> None:
    """Friction of the joint that rubs, however far its probes are from it."""
    judge, lines = traced
    (base,) = judge.search.glance.fit([restart(judge.given)], rounds=0)
    assert {line.member.label for line in lines} <= set(LABELS)
    assert len(lines) > 3
    best = max(lines, key=lambda line: line.gain)
    assert best.member.label == "coulomb_friction.b"
    first = pick_starts(base, lines, 3)[0]
    assert first.hypothesis.label == best.member.label
    values = first.points[:, 0, 0]
    assert np.abs(values - 0.12).min() < 0.06


def test_only_what_may_close_most_of_the_gap_is_looked_at(
    traced: tuple[Judge, list[Line]],
) -> None:
    """The true change may, and what takes away half of the squared errors; its rest may not."""
    judge, lines = traced
    glance = judge.search.glance
    (base,) = glance.fit([restart(judge.given)], rounds=0)
    true = next(line for line in lines if line.member.label == "coulomb_friction.b")
    assert list_closing(glance, base, [true]) == [true.member.label]
    weight = glance.replayer.used[..., None] / glance.replayer.noise
    squares = np.square(weight * base.own).sum(axis=(1, 2))
    order = np.argsort(squares)
    most = order[np.cumsum(squares[order]) > squares.sum() / 2]  # more than half, or just that
    for windows, found in ((most, [true.member.label]), (np.setdiff1d(order, most)[:-1], [])):
        own = np.isin(np.arange(len(squares)), windows)[:, None, None]
        line = true._replace(change=np.where(own, -2.0 * base.own, 0.0))
        assert list_closing(glance, base, [line]) == found


def test_pairs_promise_no_less_than_their_best_member(traced: tuple[Judge, list[Line]]) -> None:
    """Of three changes there are three pairs, each of two different ones."""
    judge, lines = traced
    (base,) = judge.search.glance.fit([restart(judge.given)], rounds=0)
    found = pick_starts(base, lines, 3) + pick_pairs(judge.search.glance, base, lines, 3)
    sizes = [len(start.hypothesis.members) for start in found]
    assert sizes == [1, 1, 1, 2, 2, 2]
    assert len({start.hypothesis.label for start in found}) == 6


def test_friction_of_another_law_is_most_alike(traced: tuple[Judge, list[Line]]) -> None:
    """A change is not alike to itself; what moves another joint is least so."""
    judge, lines = traced
    line = next(one for one in lines if one.member.label == "coulomb_friction.b")
    hypothesis = Hypothesis((line.member,))
    best, rest = judge.search.glance.fit(
        [Start(hypothesis, np.array([[0.12]])), restart(judge.given)], rounds=0
    )
    alike = [one.hypothesis.label for one in pick_alike(judge.search.glance, best, rest, lines, 5)]
    assert "viscous_friction.b" in alike[:2]
    assert all(label.endswith(".b") for label in alike[:2])
    assert "coulomb_friction.b" not in alike


def test_a_simpler_law_starts_at_the_values_that_it_shares(tmp_path: Path) -> None:
    """Friction without a Stribeck curve; not where it stands with it already."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    labels = ("coulomb_friction.a", "stribeck_friction.a", "stribeck_friction.b", "position_gain.a")
    members = {one.label: one for one in Vocabulary(data, only=labels).members}
    assert set(members) == set(labels)
    judge = Judge(data)
    stribeck = members["stribeck_friction.a"]
    values = stribeck.probes[:1]
    (fit,) = judge.search.glance.fit([Start(Hypothesis((stribeck,)), values)], rounds=0)
    (start,) = list_simpler(fit, members.values())
    assert start.hypothesis.label == "coulomb_friction.a"
    np.testing.assert_array_equal(start.points.ravel(), [values[0, 0]] * 2)
    both = join_members(fit, (members["coulomb_friction.a"],), np.array([[0.1]]))
    (fit,) = judge.search.glance.fit([both], rounds=0)
    assert list_simpler(fit, members.values()) == []


def test_lines_say_what_promises_something(traced: tuple[Judge, list[Line]]) -> None:
    """From the model as given the change that is true comes first; each label comes once."""
    judge, lines = traced
    (base,) = judge.search.glance.fit([restart(judge.given)], rounds=0)
    labels = list_promising(judge.search.glance, base, lines, 3)
    assert labels[0] == "coulomb_friction.b"
    assert len(set(labels)) == len(labels) == 3


def test_joints_without_a_gap_show_nothing(tmp_path: Path) -> None:
    """What acts on them alone is not looked at; what acts on all joints is."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    vocabulary = Vocabulary(data)
    every = {
        s.hypothesis.label for s in vocabulary.list_starts(np.zeros((*data.mask.shape, 2)), "ab")
    }
    some = {
        s.hypothesis.label for s in vocabulary.list_starts(np.zeros((*data.mask.shape, 2)), "b")
    }
    assert some < every
    assert {"coulomb_friction.b", "coulomb_friction", "gravity_tilt", "log.clock.time"} <= some
    assert {"coulomb_friction.a", "log.reversal.qpos.a"} <= every - some


def test_all_probes_of_what_promises_are_looked_at(
    traced: tuple[Judge, list[Line]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of other effects, every second one; of a mistake of the log, each."""
    judge, _ = traced
    glance = judge.search.glance
    monkeypatch.setattr(glance, "settings", replace(glance.settings, promising=1))
    (base,) = glance.fit([restart(judge.given)], rounds=0)
    starts = Vocabulary(judge.data, only=LABELS).list_starts(judge.replay_errors(judge.given), "ab")
    counts = {start.hypothesis.label: len(start.points) for start in starts}
    asked: list[str] = []
    replay = glance.replay_points

    def replay_points(some: Sequence[Start]) -> list[np.ndarray]:
        asked.extend(start.hypothesis.label for start in some)
        return replay(some)

    monkeypatch.setattr(glance, "replay_points", replay_points)
    best = max(trace_lines(glance, base, starts), key=lambda line: line.gain).member.label
    for label, count in counts.items():
        whole = label == best or label.startswith("log.")
        assert asked.count(label) == (count if whole else (count + 1) // 2)


def test_a_whole_turn_comes_nearest_to_the_log_whatever_a_line_promises(tmp_path: Path) -> None:
    """Where the discrepancy absorbs large errors, all that moves them promises the same.

    Both probes of a mistake are looked at: a turn more says nothing of a turn less.
    """
    log = arm.make_log(noise=NOISE)
    turned = log.columns["qpos.b"] + 2 * np.pi
    data = arm.data_of(Log({**log.columns, "qpos.b": turned}), tmp_path)
    judge, vocabulary = Judge(data), Vocabulary(data, robot=False)
    starts = vocabulary.list_starts(judge.replay_errors(judge.given), "ab")
    (base,) = judge.search.glance.fit([restart(judge.given)], rounds=0)
    lines = trace_lines(judge.search.glance, base, starts)
    looked_at = {float(line.point[0]) for line in lines if line.member.label == "log.turn.qpos.b"}
    assert 1.0 in looked_at
    near = {s.hypothesis.label: s for s in pick_closest(judge.search.glance, base, lines, 2)}
    assert near.keys() == {"log.turn.qpos.b", "log.turn.ctrl.b"}, "of readings, or of commands back"
    np.testing.assert_array_equal(near["log.turn.qpos.b"].points, np.ones((1, FOLDS, 1)))


def test_a_mistake_is_made_once_in_a_column(tmp_path: Path) -> None:
    """Readings that are scaled twice would shrink every error; commands may be scaled as well."""
    data = arm.data_of(arm.make_log(noise=NOISE), tmp_path)
    changes = {change.label: change for change in list_log_changes(data)}
    scaled = Hypothesis((changes["log.scale.qpos.b"],))
    for label in ("log.scale.ctrl.qpos.b", "log.scale.qpos", "log.scale.ctrl.qpos"):
        assert not are_compatible(scaled, changes[label])
    for label in ("log.scale.ctrl.b", "log.scale.qpos.a", "log.offset.qpos.b", "log.clock.time"):
        assert are_compatible(scaled, changes[label])
