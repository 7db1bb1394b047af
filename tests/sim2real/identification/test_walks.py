"""Robots whose base nobody measured: encoders, an IMU and feet on the ground."""

from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.randomization import Draw, Randomization
from envs.tasks.servo.base import ASSETS
from sim2real.identification.data import Recordings
from sim2real.identification.methods.nearby import Nearby
from sim2real.identification.prior import prior_from_tasks
from sim2real.identification.providers.replay import replay
from tests.sim2real.diagnosis.ground.walk import stretch, trot

TASKS: Any = Randomization(
    [
        Draw(make("link_mass", where="torso", how="scale"), low=0.8, high=1.2),
        Draw(make("ground_friction", how="set"), low=0.2, high=1.2),
    ]
)
FRICTION = 0.35


@pytest.mark.slow
def test_a_slippery_ground_is_found_without_the_bases_pose() -> None:
    """A quadruped that draws its legs apart slips; its base is estimated."""
    data = Recordings([stretch(FRICTION).log], ASSETS / "quad8.xml")
    prior = prior_from_tasks(TASKS, data)
    found = Nearby(transitions=50).fit(replay, prior, data)
    assert found.mean[1] == pytest.approx(FRICTION, rel=0.1)
    assert found.mean[0] == pytest.approx(1.0, rel=0.05)


def test_every_reading_has_its_noise() -> None:
    """The base's turn is compared as well; its noise is the IMU's, and no encoder's."""
    made = replay(Recordings([trot(1.5).log], ASSETS / "quad8.xml"), TASKS.effects)
    assert made.names[8:] == ("root.4", "root.5", "root.6")
    assert len(made.names) == 11 and (made.floor > 0).all()
    neutral = np.array([[1.0, 1.0]])
    off = np.sqrt(np.nanmean(made.errors(neutral) ** 2))
    assert off < 0.01, "the nominal model follows its own walk"
