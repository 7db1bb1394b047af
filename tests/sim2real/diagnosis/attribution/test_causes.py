"""Which equivalents a report names beside a cause."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution.attribute import FOLDS, Contender, Found, Search
from sim2real.diagnosis.attribution.causes import _named
from sim2real.diagnosis.attribution.fit import Fit
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.attribution.test_equivalents import option, search_of

VARIANTS = ("motor_strength.a", "motor_strength.a (braking kept)")
OTHERS = ("coulomb_friction.a", "viscous_friction.a", "armature.a")
ROTOR = 0.004  # kg·m²


def contender(search: Search, label: str, value: float) -> Contender:
    """Return an effect with a value, as if it had been fitted."""
    one = option(search, label)
    fit = Fit((one,), np.full((FOLDS, 1), value), np.zeros(FOLDS))
    return Contender(one, fit, search.base)


@pytest.fixture
def search(tmp_path: Path) -> Search:
    """Return a search among motors, friction, a rotor and its twin."""
    labels = (*VARIANTS, *OTHERS, "position_gain.a", "link_inertia.upper")
    return search_of(arm.make_log(seconds=4.0), tmp_path, *labels)


def named(search: Search, cause: str, *crowd: tuple[str, float]) -> list[tuple[str, bool]]:
    """Return the equivalents beside a cause, and whether any recording can part them."""
    own = contender(search, cause, 0.7)
    found = Found(own.fit, search.base)
    rivals = [contender(search, *one) for one in crowd]
    names, _, _ = _named(search, found, own.candidate, rivals, rivals)
    return [(one.effect, one.inseparable) for one in names]


def test_a_variant_of_an_effect_takes_no_place_of_another(search: Search) -> None:
    """Three members: the cause and two others; a second law of one effect is no third."""
    crowd = [(VARIANTS[0], 0.7), (VARIANTS[1], 0.7), ("coulomb_friction.a", 0.1)]
    found = named(search, "position_gain.a", *crowd, ("armature.a", ROTOR))
    assert found == [("motor_strength", False), ("coulomb_friction", False)]
    own = named(search, VARIANTS[0], (VARIANTS[1], 0.7), *((label, 0.1) for label in OTHERS))
    assert own == [("coulomb_friction", False), ("viscous_friction", False)]


def test_what_no_recording_parts_is_named_beyond_the_places(search: Search) -> None:
    """A link's inertia counts with the rotor's, also where three others are named already."""
    inertia = float(arm.spec().compile().body("upper").inertia[0])
    crowd = [("coulomb_friction.a", 0.1), ("armature.a", ROTOR), ("viscous_friction.a", 0.1)]
    found = named(search, VARIANTS[0], *crowd, ("link_inertia.upper", 1 + ROTOR / inertia))
    assert found == [("coulomb_friction", False), ("armature", False), ("link_inertia", True)]
