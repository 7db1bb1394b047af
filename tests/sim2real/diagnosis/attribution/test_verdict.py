"""Verdicts follow what is left, joint by joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.ties import witnesses
from sim2real.diagnosis.attribution.verdict import (
    Rest,
    crowd_of,
    imitations,
    is_no_gap,
    is_open,
    is_resolved,
    lasting,
    stands_out,
    unwitnessed,
    verdict_of,
)
from sim2real.diagnosis.preflight.clocks import check_clocks
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("before", "after", "closed", "low", "values", "verdict"),
    [
        (0.019, 0.019, 0.0, 0.0, 0, "no_gap"),  # within twice the floor
        (0.3, 0.019, 0.8, 0.7, 1, "explained"),  # what is left is
        (0.3, 0.025, 0.95, 0.9, 4, "explained"),
        (0.9, 0.04, 0.966, 0.9, 1, "explained"),  # four floors that do not last
        (0.3, 0.1, 0.7, 0.5, 1, "partly_explained"),
        (0.3, 0.019, 0.8, 0.7, 5, "fitted"),
        (0.3, 0.025, 0.95, 0.9, 13, "fitted"),
        (0.3, 0.1, 0.7, 0.5, 5, "fitted"),
        (0.3, 0.1, 0.7, -0.1, 1, "unexplained"),  # not surely anything
        (0.3, 0.25, 0.2, 0.1, 5, "unexplained"),
    ],
)
def test_verdicts_follow_what_is_left(
    tmp_path: Path,
    before: float,
    after: float,
    closed: float,
    low: float,
    values: int,
    verdict: str,
) -> None:
    """Twice the floor, nine tenths, three tenths and four values part them."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    rest = Rest(before, after, 0.01, closed, low, values=values)
    assert verdict_of(rest, data) == verdict
    if verdict == "explained" and closed >= 0.9:  # whatever lasts is still to be explained
        several = rest._replace(unsaid=True, values=2)
        assert verdict_of(several, data) == "partly_explained"


@pytest.mark.parametrize(
    ("closed", "low", "values", "form", "verdict"),
    [
        (0.96, 0.91, 1, True, "explained"),
        (0.94, 0.91, 1, True, "partly_explained"),  # a plain spring for one that loses energy: 0.92
        (0.96, 0.88, 1, True, "partly_explained"),  # not surely nine tenths
        (0.96, 0.91, 2, True, "partly_explained"),  # several wrong ones follow almost anything
        (0.96, 0.91, 1, False, "partly_explained"),  # a law that fails somewhere
    ],
)
def test_one_cause_may_leave_something_lasting(
    tmp_path: Path, closed: float, low: float, values: int, form: bool, verdict: str
) -> None:
    """A single cause whose law holds explains from nineteen twentieths on, surely nine tenths."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    rest = Rest(0.3, 0.025, 0.01, closed, low, unsaid=True, values=values, form=form)
    assert verdict_of(rest, data) == verdict


def test_three_effects_at_one_joint_explain_a_part_at_best(tmp_path: Path) -> None:
    """Together they imitate a law that is missing; shared ones, and other joints', do not count."""
    log = arm.make_log(seconds=4.0)
    data = arm.data_of(log, tmp_path)
    options = {option.label: option for option in candidates(data)}
    friction, gain, inertia, other, whole = (
        options[label]
        for label in (
            "coulomb_friction.a",
            "position_gain.a",
            "armature.a",
            "coulomb_friction.b",
            "command_delay",
        )
    )
    assert crowd_of([friction, gain, other, whole]) == 2
    assert crowd_of([friction, gain, inertia]) == 3
    assert crowd_of([whole]) == crowd_of([]) == 0
    rest = Rest(0.3, 0.015, 0.01, 0.98, 0.9, values=3)
    assert verdict_of(rest._replace(crowd=2), data) == "explained"
    assert verdict_of(rest._replace(crowd=3), data) == "partly_explained"


def test_two_effects_that_act_like_a_third_explain_a_part_at_best(tmp_path: Path) -> None:
    """At one joint, or in all; whichever of the two knows it, and once for a pair."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    every = {option.label: option for option in candidates(data)}
    falling, rising = every["stribeck_friction.a"], every["viscous_friction.a"]
    rotor = every["armature.a"]
    mass, inertia = (
        next(one for one in every.values() if one.name == name and one.joint == "a")
        for name in ("link_mass", "link_inertia")
    )
    dry, elsewhere = "dry friction", every["viscous_friction.b"]
    assert imitations([falling, rising]) == [(falling, rising, dry)]
    assert imitations([rising, falling]) == [(falling, rising, dry)]
    assert imitations([falling, elsewhere, rotor, every["coulomb_friction.a"]]) == []
    assert [pair[:2] for pair in imitations([rotor, mass])] == [(mass, rotor)]
    assert [pair[:2] for pair in imitations([mass, inertia])] == [(inertia, mass)]
    assert len(imitations([rotor, mass, inertia])) == 3
    rest = Rest(0.3, 0.015, 0.01, 0.98, 0.9, values=2)
    assert verdict_of(rest, data) == "explained"
    assert verdict_of(rest._replace(plain=False), data) == "partly_explained"


def test_a_clock_needs_a_witness_to_explain(tmp_path: Path) -> None:
    """A slow clock moves a pendulum as a heavier rod does; stamps of another clock show it."""
    log = arm.make_log(seconds=4.0)
    data = arm.data_of(log, tmp_path)
    options = {option.label: option for option in candidates(data)}
    clock, inertia = options["clock_drift"], options["armature.a"]

    def lacking(rate: float) -> list[Candidate]:
        minute = np.linspace(0.0, 60.0, len(log))
        columns = {**log.columns, "time": minute, "stamp.a": rate * minute}
        findings = check_clocks([Log(columns, log.meta)])
        return unwitnessed([inertia, clock], witnesses(findings, []))

    assert lacking(1.0) == [clock]
    assert lacking(1.02) == []
    assert unwitnessed([inertia, clock], frozenset()) == [clock]
    rest = Rest(0.3, 0.015, 0.01, 0.98, 0.9)
    assert verdict_of(rest, data) == "explained"
    assert verdict_of(rest._replace(witnessed=False), data) == "partly_explained"


@pytest.mark.parametrize(
    ("closed", "values", "form", "verdict"),
    [
        (0.86, 1, True, "explained"),  # a delay of 4 ms behind an encoder of 4096 counts: 0.89
        (0.84, 1, True, "partly_explained"),  # a wrong one can close as much
        (0.88, 2, True, "partly_explained"),
        (0.88, 1, False, "partly_explained"),
    ],
)
def test_one_cause_may_leave_what_the_encoders_do_not_show(
    tmp_path: Path, closed: float, values: int, form: bool, verdict: str
) -> None:
    """Of a small gap a count is a tenth and more: no right cause could close nine tenths of it."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    rest = Rest(8e-3, 1.3e-3, 4e-4, closed, 0.8, values=values, form=form)
    assert verdict_of(rest._replace(resolved=True), data) == verdict
    assert verdict_of(rest, data) == "partly_explained"


def test_resolved_is_about_a_count_at_every_joint(tmp_path: Path) -> None:
    """About a count, 1.15; one joint beyond is enough, however still the others are."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    counts = np.array([1.5e-3, 1.5e-3])
    joints = tuple(
        joint._replace(count=count) for joint, count in zip(data.joints, counts, strict=True)
    )
    rounded = replace(data, joints=joints)
    for off, resolved in (([1.6, 1.6], True), ([1.8, 0.1], False), ([0.1, 1.8], False)):
        error = np.where(data.mask[..., None], 1e-3 * np.array(off) / data.scale, 0.0)
        assert is_resolved(error, rounded) == resolved
    unrounded = replace(data, joints=tuple(j._replace(count=0.0) for j in data.joints))
    assert not is_resolved(np.where(data.mask[..., None], 1e-9, 0.0) + np.zeros(2), unrounded)


def test_what_a_count_hides_needs_no_less_to_be_closed(tmp_path: Path) -> None:
    """Of several causes nine tenths are asked for, also where one count hides the rest."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    joints = tuple(joint._replace(count=1.5e-3 * joint.scale) for joint in data.joints)
    data = replace(data, joints=joints)
    rest = Rest(6e-3, 1.4e-3, 4e-4, closed=0.92, low=0.8, values=2, resolved=True)
    assert verdict_of(rest, data) == "explained"
    assert verdict_of(rest._replace(closed=0.89), data) == "partly_explained"
    assert verdict_of(rest._replace(unsaid=True), data) == "partly_explained"


def test_one_joint_that_stands_out_is_a_gap(tmp_path: Path) -> None:
    """Seven joints at their floor do not hide the eighth, and it has to be explained as well."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    floors = np.array([1e-3, 1e-3])
    error = np.where(data.mask[..., None], [1e-3, 2.9e-3], 0.0)
    assert not stands_out(error, data, floors)
    error = np.where(data.mask[..., None], [1e-3, 3.1e-3], 0.0)
    assert stands_out(error, data, floors)
    assert is_no_gap(1.5e-3, 1e-3, data, alone=False)
    assert not is_no_gap(1.5e-3, 1e-3, data, alone=True)
    assert verdict_of(Rest(1.5e-3, 1.4e-3, 1e-3, 0.1, 0.0, (True, True)), data) == "unexplained"
    assert verdict_of(Rest(1.5e-3, 1.0e-3, 1e-3, 0.6, 0.3, (True, False)), data) == "explained"


def test_what_lasts_is_told_from_noise(tmp_path: Path) -> None:
    """Noise of every row may be larger than the floor says; a wave of that size is a wrong law."""
    data = arm.data_of(arm.make_log(seconds=24.0), tmp_path)
    floors, rng = np.array([1e-3, 1e-3]), np.random.default_rng(0)
    shape = (*data.mask.shape, 2)
    noise = np.where(data.mask[..., None], 5e-3 * rng.normal(size=shape), 0.0)
    assert (lasting(noise, data) < 1e-3).all()
    assert not is_open(noise, data, floors)
    wave = np.zeros(shape)
    for k, time in enumerate(data.times()):
        wave[k, : len(time), 1] = 5e-3 * np.sin(2 * np.pi * time)
    wave[~data.mask] = 0.0
    assert lasting(noise + wave, data)[1] == pytest.approx(5e-3 / np.sqrt(2), rel=0.1)
    assert is_open(noise + wave, data, floors)


@pytest.mark.parametrize(("counts", "open_"), [(0.8, False), (1.3, True)])
def test_less_than_an_encoder_resolves_is_nothing_left(
    tmp_path: Path, counts: float, open_: bool
) -> None:
    """One count is the limit, not two: a wrong spring left 1.7 of them and nine tenths closed."""
    count = 2 * np.pi / 4096
    log = arm.make_log(seconds=8.0)
    read = {n: np.round(log.columns[n] / count) * count for n in ("qpos.a", "qpos.b")}
    data = arm.data_of(replace(log, columns={**log.columns, **read}), tmp_path)
    assert [joint.count for joint in data.joints] == pytest.approx([count, count])
    error = np.where(data.mask[..., None], counts * count, 0.0)
    assert is_open(error, data, np.array([count, count]) / np.sqrt(12)) == open_
