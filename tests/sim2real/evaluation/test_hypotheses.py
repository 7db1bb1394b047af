"""Claims are decided by the rules that they were registered under."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2real.evaluation.hypotheses import Claim, ClaimError, evaluate_claim, load_claims
from sim2real.evaluation.study import Study, collect
from sim2real.runs.statistics import bootstrap, iqm, mean, probability_of_improvement
from tests.sim2real.made_runs import make_run

SIDES: dict[str, Any] = {
    "left": {"experiment": "udr", "robot": "target"},
    "right": {"experiment": "ppo_source", "robot": "target"},
}


def claim(relation: str, **more: Any) -> Claim:
    """Return a claim about udr against ppo_source on the target."""
    return Claim.of({"claim": "some", "is": relation, "seeds": 5} | SIDES | more)


def study(root: Path, udr: Sequence[float], source: Sequence[float]) -> Study:
    """Return runs with these returns on the target, and 1000 more on the source."""
    for name, values in (("udr", udr), ("ppo_source", source)):
        for seed, value in enumerate(values):
            make_run(root, name, seed, (value + 1000, value))
    return Study(collect([root]))


def verdict(found: Study, what: Claim) -> str:
    """Return what becomes of a claim."""
    return evaluate_claim(what, found, 0, 500).verdict


def test_an_ordering_holds_only_where_it_is_sure(tmp_path: Path) -> None:
    """Clearly above: held, and its reverse fails; equal groups are similar and nothing else."""
    high, low = [110, 120, 130, 140, 150], [10, 20, 30, 40, 50]
    apart = study(tmp_path / "apart", high, low)
    relations = ("above", "below", "similar", "not_above")
    assert [verdict(apart, claim(r)) for r in relations] == ["held", "failed", "failed", "failed"]
    same = study(tmp_path / "same", low, low)
    assert [verdict(same, claim(r)) for r in relations] == ["failed", "failed", "held", "held"]


def test_a_probability_is_needed_besides_the_interval(tmp_path: Path) -> None:
    """The estimate is 0.88 and surely above a half: enough for 0.75, too little for 0.95."""
    found = study(tmp_path, [30, 60, 70, 80, 90], [10, 20, 40, 50, 55])
    assert verdict(found, claim("above", probability=0.75)) == "held"
    assert verdict(found, claim("above", probability=0.95)) == "failed"


def test_a_factor_moves_the_right_side(tmp_path: Path) -> None:
    """Less than the other, and more than half of it."""
    found = study(tmp_path, [60, 61, 62, 63, 64], [100, 101, 102, 103, 104])
    assert verdict(found, claim("below")) == "held"
    assert verdict(found, claim("below", times=0.5)) == "failed"
    assert verdict(found, claim("above", times=0.5)) == "held"


def test_both_sides_of_one_run_are_paired(tmp_path: Path) -> None:
    """Each run loses a little: that drowns in the spread of the runs unless they are paired."""
    found = study(tmp_path, [1000, 3000, 5000, 7000, 9000], [1, 2, 3, 4, 5])
    home = {"experiment": "udr", "robot": "source"}
    assert verdict(found, claim("below", right=home, probability=0.99)) == "held"


def test_a_range_is_for_the_middle_of_the_runs(tmp_path: Path) -> None:
    """One failed run does not move the interquartile mean out of the range."""
    found = study(tmp_path, [0, 100, 101, 102, 103], [1, 2, 3, 4, 5])
    assert verdict(found, claim("within", right=None, range=[90, 110])) == "held"
    assert verdict(found, claim("within", right=None, range=[104, 110])) == "failed"


def test_few_runs_decide_nothing(tmp_path: Path) -> None:
    """However clear they look; nor do runs that are not there, or that could be several groups."""
    found = study(tmp_path, [110, 120, 130, 140], [10, 20, 30, 40, 50])
    assert verdict(found, claim("above")) == "not enough seeds"
    other = {"experiment": "ndr", "robot": "target"}
    assert verdict(found, claim("above", left=other)) == "not enough seeds"
    for width in (0.1, 0.2):
        make_run(tmp_path, "wide", 0, (1, 1), params={"width": width})
    several = {"experiment": "wide", "robot": "target"}
    assert verdict(Study(collect([tmp_path])), claim("above", left=several)) == "ambiguous"


def test_runs_are_compared_after_the_same_steps(tmp_path: Path) -> None:
    """The sweep ended at 300k, where the baseline was worse than it is at its end."""
    for seed in range(5):
        make_run(tmp_path, "udr", seed, (0, 50 + seed), steps=300_000)
        make_run(tmp_path, "ppo_source", seed, (0, 10 + seed), steps=300_000)
        make_run(tmp_path, "ppo_source", seed, (0, 90 + seed), steps=500_000)
    found = evaluate_claim(claim("above"), Study(collect([tmp_path])), 0, 500)
    assert (found.verdict, found.steps) == ("held", 300_000)


def test_the_training_counts_too(tmp_path: Path) -> None:
    """A curve that rises to 100 and ends at 40 has lost a fifth; one that ends at 95 has not."""
    for seed in range(5):
        make_run(tmp_path, "wild", seed, (0, 0), curve=[(1, 10), (2, 100 + seed), (3, 40)])
        make_run(tmp_path, "calm", seed, (0, 0), curve=[(1, 10), (2, 100 + seed), (3, 95)])
    found = Study(collect([tmp_path]))
    for name, expected in (("wild", "held"), ("calm", "failed")):
        last, most = (
            {"experiment": name, "metric": "train/return", "take": take} for take in ("last", "max")
        )
        assert verdict(found, claim("below", left=last, right=most, times=0.8)) == expected
    kl = {"experiment": "wild", "metric": "train/kl"}
    lacking = evaluate_claim(claim("above", left=kl, right=kl), found, 0, 500)
    assert lacking.verdict == "not enough seeds" and "no train/kl" in lacking.found


def test_the_newest_registration_counts_once(tmp_path: Path) -> None:
    """Runs of one experiment all carry its claims; a claim of two experiments is one."""
    tree = {"claim": "some", "is": "above", "seeds": 5} | SIDES
    for name in ("udr", "ppo_source"):
        for seed in (0, 1):
            make_run(tmp_path, name, seed, (1, 1), expect={"claims": [tree]})
    assert [c.text for c in load_claims(collect([tmp_path]))] == ["some"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"is": "abvoe"}, r"is='abvoe' \(did you mean 'above'\?\)"),
        ({"is": "within"}, "says within and needs range"),
        ({"right": None}, "says above and needs right"),
        ({"probabilty": 1}, r"does not accept 'probabilty' \(did you mean 'probability'"),
        ({"left": {"experiment": "udr"}}, "needs either a robot or a metric"),
        ({"left": {"robot": "target"}}, "also needs experiment"),
        ({"left": {"experiment": "udr", "metric": "x", "take": "mean"}}, "take='mean'"),
    ],
)
def test_what_is_no_claim_is_refused(change: dict[str, Any], message: str) -> None:
    """One sentence each, with what is allowed."""
    with pytest.raises(ClaimError, match=message):
        Claim.of({"claim": "some", "is": "above", "seeds": 5} | SIDES | change)


# Mean return over 161 cells of mass and friction, of the five published training seeds of each
# condition in the results of ES-Sim2Real (github.com/artificial-cesare/ES-sim2real).
PUBLISHED = {
    "one robot": [854.68, 637.69, 1048.49, 919.68, 488.43],
    "drawn once": [786.22, 877.81, 956.15, 1300.29, 880.64],
    "drawn each episode": [932.18, 1187.93, 995.09, 981.69, 911.18],
}


def test_published_results_come_out_as_they_were_published() -> None:
    """Means 790, 960, 1002; five seeds do not tell the three apart for sure."""
    rng = np.random.default_rng(0)
    runs = {name: np.array(values)[:, None] for name, values in PUBLISHED.items()}
    found = {k: bootstrap(v, mean, rng, draws=5000, resample="rows") for k, v in runs.items()}
    assert [round(x.value) for x in found.values()] == [790, 960, 1002]
    ends = np.array([[x.low, x.high] for x in found.values()])
    np.testing.assert_allclose(ends, [[621, 958], [839, 1132], [932, 1096]], atol=20)
    one, once, each = runs.values()
    pairs = [(once, one), (each, once), (each, one)]
    chances = [probability_of_improvement(*pair, rng, draws=5000) for pair in pairs]
    assert [round(x.value, 2) for x in chances] == [0.68, 0.72, 0.8]
    assert all(x.low <= 0.5 for x in chances)
    assert iqm(each) == pytest.approx(np.mean([981.69, 995.09, 932.18]))
