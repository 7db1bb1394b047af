"""Friction at the feet is known only where feet slip."""

import pytest

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.ground.estimate import estimate_all
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.inference.grip import check_grip
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis.ground.walk import Walk, stretch, sway, without

FLOOR = 1e-3  # rad


def said(walk: Walk) -> list[Finding]:
    """Return what is said of the feet in a walk."""
    estimates = estimate_all([without(walk.log, "accelerometer")], None, DEFAULT.ground)
    data = grounded(Data.of([one.log for one in estimates]), estimates)
    return check_grip(Replayer(data), FLOOR)


@pytest.mark.slow
def test_of_feet_that_hardly_slip_it_is_said_that_nothing_is_known() -> None:
    """Of all feet as one, with the coefficients that were tried."""
    found = {finding.where: finding.finding for finding in said(sway(0.02))}
    assert "The friction between the feet and the ground is not known" in found[None]
    assert "neither less nor more of it" in found[None]
    assert "With 0.56 and 1.2 in place of 0.8" in found[None]


@pytest.mark.slow
def test_feet_that_slip_tell_their_friction() -> None:
    """Front legs drawn against back legs, on a ground that grips less than it might."""
    assert None not in {finding.where for finding in said(stretch(0.8))}
