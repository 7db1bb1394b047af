"""What a model without physics catches: anything with a memory, and no noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution.free_form import caught, foreseen
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm, motors

NOISE = 5e-4


def errors(folder: Path, *effects: tuple[str, dict, float]) -> tuple[Data, np.ndarray]:
    """Return a log's windows and what the model without the effects is off by in them."""
    data = arm.data_of(arm.make_log(*effects, seconds=24.0, noise=NOISE), folder)
    return data, Problem(data, Simulator(data, [])).held_out((), np.zeros((2, 0)))


@pytest.mark.parametrize(
    ("effect", "least"),
    [
        (("command_delay", {}, 0.02), 0.9),
        (("viscous_friction", {"where": "a"}, 0.1), 0.3),
        (("backlash", {"where": "b", "side": "link"}, 0.03), 0.4),
        (("thermal_derating", {"where": "a"}, 0.02), 0.3),
    ],
)
def test_what_an_effect_does_is_foreseen(
    tmp_path: Path, effect: tuple[str, dict, float], least: float
) -> None:
    """On the half of the log that it was not fitted to; play and delays have a memory."""
    data, error = errors(tmp_path, effect)
    assert caught(error, foreseen(data, error)) > least


def test_what_rubs_is_foreseen_by_what_was_before(tmp_path: Path) -> None:
    """A servo's sag follows its load of a while ago: the present moment shows a third of it."""
    data, error = errors(tmp_path, ("viscous_friction", {"where": "a"}, 0.1))
    limits = replace(data.settings.residual, lags_s=(), plays=(), decays_s=())
    present = replace(data, settings=replace(data.settings, residual=limits))
    now, before = (caught(error, foreseen(d, error)) for d in (present, data))
    assert before > 2 * now


def test_friction_of_a_joint_that_no_servo_holds_is_foreseen(tmp_path: Path) -> None:
    """Torques are logged: what rubs shows as its double integral from a window's start."""
    data = Data.of([motors.make_log(0.3, 12.0)], motors.model(tmp_path))
    error = Problem(data, Simulator(data, [])).held_out((), np.zeros((2, 0)))
    assert caught(error, foreseen(data, error)) > 0.3


def test_noise_is_not_foreseen(tmp_path: Path) -> None:
    """Where nothing is hidden nothing is caught, and what is not compared stays 0."""
    data, error = errors(tmp_path)
    guess = foreseen(data, error)
    assert caught(error, guess) < 0.02
    assert (guess[~data.mask] == 0).all()
