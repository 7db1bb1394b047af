"""Gravity that one side compensates: against models that do so themselves."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import Effect
from envs.plant import Plant
from envs.replay import rollout
from sim2real.diagnosis.inference.hypotheses import get_kind
from sim2real.diagnosis.inference.world_changes import GravityCompensation, list_world_changes
from tests.sim2real.diagnosis import arm


def swing(gravcomp: float, effects: list[Effect], value: float) -> np.ndarray:
    """Return where the arm ends up after half a second, its bodies compensated so far."""
    spec = arm.spec()
    for body in spec.bodies[1:]:
        body.gravcomp = gravcomp
    plant = Plant(spec, effects, 1, threads=1)
    every, start = np.zeros(1, int), np.array([[0.8, 0.3]])
    plant.set_params(every, np.full((1, len(effects)), value))
    plant.reset(every, start, 0 * start, np.zeros(1, np.uint64), start, measured=True)
    return rollout(plant, start[:, None].repeat(250, axis=1))[0, -1]


@pytest.mark.parametrize(("given", "value", "wanted"), [(0.0, 1.0, 1.0), (1.0, -1.0, 0.0)])
def test_it_is_what_a_model_with_it_does(given: float, value: float, wanted: float) -> None:
    """All of it beyond a model without any, and none of it from a model that has all."""
    changed = swing(given, [GravityCompensation()], value)
    np.testing.assert_allclose(changed, swing(wanted, [], 0.0), atol=1e-9)
    assert np.abs(changed - swing(given, [], 0.0)).max() > 1e-3


def test_the_world_is_told_from_the_robot(tmp_path: Path) -> None:
    """A tilted base and compensation are changes of the world."""
    found = list_world_changes(arm.data_of(arm.make_log(seconds=4.0), tmp_path))
    assert [change.name for change in found] == ["gravity_compensation", "gravity_tilt"]
    assert {get_kind(change) for change in found} == {"world"}
