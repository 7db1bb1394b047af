"""What is simulated side by side comes to what it does alone."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects.base import PLAIN, RULES
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Run, Simulated, Simulator
from sim2real.diagnosis.inference.batches import Rows, simulate_each
from sim2real.diagnosis.inference.candidates import Candidate, candidates
from tests.sim2real.diagnosis import arm

WINDOWS = np.array([0, 2])


class Counting(Simulator):
    """Counts batches and the effects in each."""

    def run_each(self, runs: list[Run]) -> list[Simulated]:
        """Take note and simulate."""
        self.batches = [len(run.effects) for run in runs]
        return super().run_each(runs)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Data:
    """Return a log with friction, and its model."""
    folder: Path = tmp_path_factory.mktemp("arm")
    return arm.data_of(arm.make_log(("coulomb_friction", {"where": "a"}, 0.1)), folder)


def rows(*members: Candidate) -> Rows:
    """Return two windows under the middle probe of each candidate."""
    point = np.concatenate([m.probes[len(m.probes) // 2] for m in members])
    return Rows(members, WINDOWS, np.tile(point, (len(WINDOWS), 1)))


@pytest.mark.slow
def test_rows_are_the_same_beside_others_as_alone(data: Data) -> None:
    """To the bit: of every effect that is stepped, beside all the others of its kind."""
    options = [o for o in candidates(data) if o.group in (PLAIN, RULES)]
    simulator = Counting(data, threads=1)
    side_by_side = simulate_each(simulator, [rows(option) for option in options])
    kinds = [sum(option.group == kind for option in options) for kind in (PLAIN, RULES)]
    assert sorted(simulator.batches) == sorted(kinds) and min(kinds) > 5
    changed = 0
    for option, found in zip(options, side_by_side, strict=True):
        (alone,) = simulate_each(simulator, [rows(option)])
        for one, other in zip(alone, found, strict=True):
            assert np.array_equal(one, other), option.label
        changed += bool(np.abs(found.error - side_by_side[0].error).max() > 0)
    assert changed > len(options) // 2


def test_what_adds_to_the_model_is_simulated_by_itself(data: Data) -> None:
    """A structure has a batch of its own, which rows with the same structure share."""
    options = {option.label: option for option in candidates(data)}
    play, dry = options["backlash.a (link side)"], options["coulomb_friction.a"]
    drag, excess = options["viscous_friction.b"], options["stribeck_friction.b"]
    simulator = Counting(data, threads=1)
    sets = [rows(play), rows(dry), rows(play, drag), rows(excess), rows(drag)]
    found = simulate_each(simulator, sets)
    assert simulator.batches == [2, 2, 1]
    for one, together in zip(sets, found, strict=True):
        (alone,) = simulate_each(simulator, [one])
        assert np.array_equal(alone.error, together.error)


def test_effects_in_another_order_have_a_batch_of_their_own(data: Data) -> None:
    """One adds to a field what another one multiplies: their order counts."""
    options = {option.label: option for option in candidates(data)}
    one, other = options["position_gain.a"], options["motor_strength.a"]
    simulator = Counting(data, threads=1)
    simulate_each(simulator, [rows(one, other), rows(other, one), rows(one), rows(other)])
    assert simulator.batches == [2, 2]
