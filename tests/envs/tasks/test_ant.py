"""The ant's contact forces."""

import numpy as np
import pytest

from envs.effects import make
from envs.errors import TaskError
from envs.simulation import Simulation
from envs.tasks import Ant


def test_contact_forces_are_each_rows_own() -> None:
    """The exact forces of a row know its own masses and do not depend on the rows beside it."""
    heavy = [make("link_mass", where="torso", how="add")]
    values, seeds = np.array([[0.0], [5.0], [0.0]]), np.zeros(3, np.uint64)
    simulation = Simulation(Ant(contact_forces="exact"), 3, heavy, threads=2)
    simulation.reset(np.arange(3), values, seeds)
    for _ in range(30):  # it falls onto its feet
        step = simulation.step(None, np.zeros((3, 8)))
    forces = step.observation[:, 27:]
    assert np.abs(forces[0]).max() > 0.0
    np.testing.assert_array_equal(forces[0], forces[2])
    assert not np.array_equal(forces[0], forces[1])


def test_choices_are_named() -> None:
    """An unknown mode is refused with what there is."""
    with pytest.raises(
        TaskError, match=r"contact_forces='exakt'.*did you mean 'exact'.*off, exact"
    ):
        Ant(contact_forces="exakt")  # type: ignore[arg-type]
