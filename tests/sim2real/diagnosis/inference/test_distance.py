"""Whether an explanation stands alone, among fits of which it is known how well each predicts."""

from types import SimpleNamespace
from typing import Any

from sim2real.diagnosis.inference.distance import share_joint, stands_alone
from sim2real.diagnosis.inference.hypotheses import Hypothesis


def fit(*labels: str, worse: bool = False) -> Any:
    """Return what stands for a fit."""
    members = [SimpleNamespace(label=label) for label in labels]
    return SimpleNamespace(hypothesis=SimpleNamespace(members=members), worse=worse)


def member(name: str, place: str | None) -> Any:
    """Return what stands for an effect at a place."""
    return SimpleNamespace(name=name, place=place)


def alone(best: Any, *others: Any) -> bool:
    """Return whether the best stands alone among others."""

    def distinct(other: Any) -> bool:
        return other.worse

    return stands_alone(best, others, distinct)


def test_quite_other_causes_that_do_as_well_contest() -> None:
    """Two others do, one in the place of one does not, and neither does what is worse."""
    best = fit("friction.a", "delay")
    assert alone(best, fit("friction.b", "delay"))
    assert not alone(best, fit("friction.b", "lag"))
    assert alone(best, fit("friction.b", "lag", worse=True))
    assert alone(best, fit("friction.b", "lag", "play"))  # it is longer


def test_two_equivalents_together_are_no_other_explanation() -> None:
    """Each stands for one of the best by itself as well; one alone does not excuse both."""
    best, both = fit("inertia", "mass"), fit("rotor", "strength")
    one, other = fit("rotor", "mass"), fit("inertia", "strength")
    assert alone(best, both, one, other)
    assert alone(best, both, one)  # the strength is in the place of the mass then
    assert not alone(best, both, fit("rotor", "mass", worse=True))


def test_two_effects_at_one_joint_may_imitate_a_law() -> None:
    """Not two at different joints, not with a value for all, and not where there is one joint."""
    friction, play, lag = (member(name, "elbow") for name in ("friction", "play", "lag"))
    together = Hypothesis((friction, play))
    assert share_joint(together, 2)
    assert not share_joint(together, 1)
    assert share_joint(Hypothesis((friction, member("delay", None), lag)), 6)
    assert not share_joint(Hypothesis((friction, member("play", "wrist"))), 6)
    assert not share_joint(Hypothesis((member("friction", None), member("play", None))), 6)
