"""The search: how many changes it fits, by what their lines promise."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from sim2real.diagnosis.inference import search as searching
from sim2real.diagnosis.inference.fit import Fit, Start
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from tests.sim2real.diagnosis import arm

PROPOSED = ("coulomb_friction.a", "coulomb_friction.b", "viscous_friction.b", "position_gain.b")


@pytest.mark.parametrize(
    ("gain", "gap", "every"), [(0.0, True, True), (0.0, False, False), (1e6, True, False)]
)
def test_where_no_slope_promises_anything_every_change_is_fitted(
    gain: float, gap: bool, every: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else as many as promise most, also without a gap; a stop that none reaches has no slope."""
    data = arm.data_of(
        arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=3e-4), tmp_path
    )
    judge, vocabulary = Judge(data), Vocabulary(data, only=PROPOSED)
    search = judge.search
    search.settings = replace(judge.settings, refits=2, alike=0)
    judge.choices, asked = len(vocabulary.members), []
    lines = searching.trace_lines
    monkeypatch.setattr(
        searching,
        "trace_lines",
        lambda *about: [line._replace(gain=gain) for line in lines(*about)],
    )

    def note(starts: Sequence[Start], tried: dict[str, Fit]) -> None:
        asked.append(len({start.hypothesis.label for start in starts}))

    monkeypatch.setattr(search, "_fit", note)
    monkeypatch.setattr(judge, "explains", lambda fit: not gap)
    starts = vocabulary.list_starts(judge.replay_errors(judge.given), list(arm.JOINTS))
    search.refine(judge.given, starts, {})
    assert asked[0] == (len(PROPOSED) if every else 2)


def test_what_mends_the_log_takes_no_place_of_what_leaves_it(tmp_path: Path) -> None:
    """The best of each is fitted among what is alike, whatever the unknowns around one say."""
    data = arm.data_of(
        arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=3e-4), tmp_path
    )
    judge, shift = Judge(data), "log.row_shift.ctrl"
    vocabulary = Vocabulary(data, only=(*PROPOSED, shift))
    judge.choices, tried = len(vocabulary.members), dict[str, Fit]()
    starts = vocabulary.list_starts(judge.replay_errors(judge.given), list(arm.JOINTS))
    assert len(starts) == len(PROPOSED) + 1
    judge.search._fit(starts, tried)
    assert set(tried) == {"coulomb_friction.b", "viscous_friction.b"}
    judge.search._fit(starts, tried, alike=True)
    assert set(tried) == {"coulomb_friction.b", "viscous_friction.b", shift}
