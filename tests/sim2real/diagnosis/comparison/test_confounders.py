"""What temperature may have done is simulated, and only what that leaves is compared."""

import numpy as np
import pytest

from sim2real.diagnosis.comparison.confounders import confounders, excuse
from sim2real.diagnosis.comparison.pieces import contrasts
from sim2real.diagnosis.comparison.prepared import prepare
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.comparison.test_compare import WATCH, noisy

FRICTION = ("coulomb_friction", {"where": None})
BEFORE, AFTER = [0], [1]


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> str:
    """The arm's file."""
    return arm.model(tmp_path_factory.mktemp("arm"))


@pytest.mark.slow
def test_colder_joints_are_simulated_until_noise_is_left(model) -> None:
    """One arm is 20 K colder than the other and has a quarter more friction in all joints.

    Both are recorded along one motion: their noise's difference is all that stays.
    """
    logs = [
        noisy(
            arm.make_log((*FRICTION, value), seconds=12.0, seed=3),
            n,
            temperature=warm,
            voltage=12.0,
        )
        for n, (value, warm) in enumerate([(0.08, 30.0), (0.1, 10.0)])
    ]
    made = prepare(logs, model, [], WATCH, DEFAULT)
    first = contrasts(made, made.error, BEFORE, AFTER)
    beside = confounders(made, BEFORE, AFTER, True)
    pieces, changes = excuse(first, made, (BEFORE, AFTER), beside)
    assert np.sqrt(np.mean(pieces.rms**2) / np.mean(first.rms**2)) < 0.5
    moved = {made.response.columns[k].option.name: change for k, change in changes.items()}
    assert moved["coulomb_friction"] == pytest.approx(0.02, rel=0.15)


@pytest.mark.parametrize(("warm", "kelvins"), [(40.0, 10.0), (30.2, 1.0)])
def test_what_may_be_a_kelvins_is_no_change(model, warm: float, kelvins: float) -> None:
    """Half a per cent a kelvin: of a joint's friction, seen as either kind; of its strength."""
    logs = [
        noisy(arm.make_log((*FRICTION, 0.08), seconds=6.0, seed=3), n, temperature=t, voltage=12.0)
        for n, t in enumerate([30.0, warm])
    ]
    names = ("coulomb_friction", "viscous_friction", "motor_strength", "encoder_offset")
    made = prepare(logs, model, [], names, DEFAULT)
    columns = made.response.columns
    least = confounders(made, BEFORE, AFTER, True).least
    joints = [j.name for j in made.data.joints]
    own = dict.fromkeys(joints, 0.0)
    for k, size in made.friction.items():
        own[str(columns[k].option.place)] += size
    for k, column in enumerate(columns):
        name, place = column.option.name, column.option.place
        if name == "encoder_offset":
            assert least[k] == 0
        elif name == "motor_strength":
            assert least[k] == pytest.approx(0.005 * kelvins)
        else:
            size = np.mean(list(own.values())) if place is None else own[place]
            assert size > 0.05 and least[k] == pytest.approx(0.005 * kelvins * size)
