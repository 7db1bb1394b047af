"""A few steps from the middle of the prior to a simulated robot's parameters."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.models import named
from envs.randomization import Draw, Randomization
from envs.simulation import Simulation
from envs.tasks import Hopper
from sim2real.identification.data import Recordings
from sim2real.identification.episodes import EpisodeIdentifier
from sim2real.identification.methods.nearby import Nearby
from sim2real.identification.prior import prior_from_tasks
from sim2real.identification.providers.replay import replay
from sim2real.learning.population.recording import record
from sim2real.runs.errors import Sim2RealError

TASKS: Any = Randomization(
    [
        Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0),
        Draw(make("ground_friction", how="set"), low=1.5, high=2.5),
    ]
)


def recordings(truth: list[float], folder: Path) -> Recordings:
    """Return a short episode of a Hopper under random actions."""
    robot = Simulation(Hopper(), 1, TASKS.effects, threads=1)
    rng = np.random.default_rng(0)

    def act(observation: np.ndarray) -> np.ndarray:
        return rng.uniform(-1, 1, (len(observation), 3))

    log = record(robot, act, np.array([5], np.uint64), np.array([truth])).log
    model = folder / "hopper.xml"
    model.write_text(named(Hopper().spec()).to_xml(), encoding="utf-8")
    return Recordings([log], model)


@pytest.mark.parametrize("truth", [[1.5, 1.7], [8.0, 2.2]])
def test_it_moves_from_the_middle_to_the_truth(truth: list[float], tmp_path: Path) -> None:
    """Half a second of falling tells the mass; friction where the foot slips."""
    data = recordings(truth, tmp_path)
    prior = prior_from_tasks(TASKS, data)
    found = Nearby(transitions=30).fit(replay, prior, data)
    assert found.mean[0] == pytest.approx(truth[0], rel=0.01)
    assert abs(found.mean[1] - truth[1]) <= abs(prior.mean[1] - truth[1]) + 1e-9
    assert (found.std < prior.std + 1e-9).all()
    again = Nearby(transitions=30).fit(replay, prior, data)
    np.testing.assert_array_equal(found.mean, again.mean)


def test_a_robot_beyond_the_ranges_of_training_is_found(tmp_path: Path) -> None:
    """A torso of 11 kg where training has 9 at most; what means nothing stays out."""
    data = recordings([11.0, 2.0], tmp_path)
    prior = prior_from_tasks(TASKS, data, beyond=0.5)
    np.testing.assert_allclose([prior.low[1], prior.high[1], prior.high[0]], [1.0, 3.0, 13.0])
    assert 0 <= prior.low[0] < 1.0, "1 - 4 kg would be no mass"
    assert Nearby(transitions=30).fit(replay, prior, data).mean[0] == pytest.approx(11.0, rel=0.01)


def test_numbers_out_of_range_are_refused() -> None:
    """No rows, no transitions, no steps, no difference, another word than auto."""
    for wrong in ({"rows": 0}, {"transitions": 0}, {"rows": "all"}, {"steps": 0}):
        with pytest.raises(Sim2RealError, match="must be at least 1"):
            Nearby(**wrong)  # type: ignore[arg-type]
    with pytest.raises(Sim2RealError, match="difference=0 above 0"):
        Nearby(difference=0.0)
    with pytest.raises(Sim2RealError, match="beyond=-1 must not be below 0"):
        EpisodeIdentifier(Nearby(), beyond=-1.0)
