"""Counts and phases of a ripple, seen in the error."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.candidates import candidates
from sim2real.diagnosis.inference.cogging import with_ripples
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.replayer import Replayer
from tests.sim2real.diagnosis import arm


def seen(log: Log, folder: Path, ripples: float, amplitude: float) -> None:
    """Check count, phase and amplitude of the first probe at the second joint."""
    data = arm.data_of(log, folder)
    error, _ = Replayer(data).follow(Hypothesis(()), np.zeros((len(data.windows), 0)))
    (own,) = (c for c in candidates(data) if c.label == "cogging.b")
    size, count, phase = with_ripples(own, data, error).probes[0]
    told = np.pi / np.ptp(data.measured[..., 1])  # half of what the joint's span tells apart
    assert count == pytest.approx(ripples, abs=told)
    assert phase == pytest.approx(1.1, abs=0.8)
    assert 0.25 < size / amplitude < 4.0


@pytest.mark.parametrize("ripples", [17.0, 41.3, 6.5])
def test_the_error_shows_how_many_ripples_a_turn_has(ripples: float, tmp_path: Path) -> None:
    """The first probe has the hidden count, whole or not, and about its phase and amplitude."""
    hidden = {"where": "b", "count": ripples, "phase": 1.1}
    seen(arm.make_log(("cogging", hidden, 0.12)), tmp_path, ripples, 0.12)


def test_a_swell_is_no_ripple(tmp_path: Path) -> None:
    """What goes on for a third of a turn has another cause: no fit may call it a motor's."""
    swell = {"where": "b", "count": 2.7, "phase": 1.1}
    data = arm.data_of(arm.make_log(("cogging", swell, 0.5)), tmp_path)
    error, _ = Replayer(data).follow(Hypothesis(()), np.zeros((len(data.windows), 0)))
    (own,) = (c for c in candidates(data) if c.label == "cogging.b")
    tuned = with_ripples(own, data, error)
    assert own.low[1] == 3.0
    assert tuned.probes[:, 1].min() >= own.low[1]


@pytest.mark.parametrize("ripples", [9.0, 13.3])
def test_the_error_of_a_joint_that_nothing_holds_shows_them_too(
    ripples: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Motors alone: the ripple shows as its double integral over the inertia."""
    motors = '<motor name="a" joint="a" gear="0.3"/><motor name="b" joint="b" gear="0.1"/>'
    start, end = arm.XML.index("<actuator>"), arm.XML.index("</actuator>")
    xml = arm.XML[:start] + "<actuator>" + motors + arm.XML[end:]
    monkeypatch.setattr(arm, "XML", xml.replace("armature", 'damping="0.03" armature'))
    hidden = {"where": "b", "count": ripples, "phase": 1.1}
    seen(arm.make_log(("cogging", hidden, 0.01), seconds=16.0), tmp_path, ripples, 0.01)


def test_an_actuator_at_a_site_is_no_servo_of_the_joint_of_its_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ripple is as large as the joint's own servo is stiff."""
    log = arm.make_log(("cogging", {"where": "b", "count": 17.0, "phase": 1.1}, 0.12))
    law = 'gear="1 0 0 0 0 0" gainprm="0" biastype="affine" biasprm="0 -4000 0"'
    xml = arm.XML.replace("</worldbody>", '<site name="s"/><site name="b"/></worldbody>')
    monkeypatch.setattr(
        arm, "XML", xml.replace("<actuator>", f'<actuator><general name="push" site="b" {law}/>')
    )
    seen(log, tmp_path, 17.0, 0.12)
