"""What is watched for a change is moved a little, one thing at a time."""

import numpy as np

from sim2real.diagnosis.comparison.prepared import prepare
from sim2real.diagnosis.comparison.response import respond, watched
from sim2real.diagnosis.settings import DEFAULT
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.comparison.test_compare import driven, noisy


def test_play_of_all_joints_is_not_watched_beside_that_of_one(tmp_path):
    """A joint has one play: once both sides have it at one joint, the others' stay."""
    sides = [noisy(driven(), 1), noisy(driven(), 2)]
    made = prepare(sides, arm.model(tmp_path), [], ["payload"], DEFAULT)
    watch = watched(made.data, [], ["backlash"])
    places = {option.effect.where for option in watch.options}
    assert places == {None, *arm.JOINTS}
    own = next(option for option in watch.options if option.effect.where == "a")
    watch = watch.having(own, np.array(own.probes[0]))
    response = respond(made.simulator, watch, made.windows[:1])
    assert {column.option.effect.where for column in response.columns} == set(arm.JOINTS)
    assert np.isfinite(response.change).all()
