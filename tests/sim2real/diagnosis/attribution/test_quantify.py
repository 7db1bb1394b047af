"""How sure values are; shares and intervals of fits are tested with the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.quantify import _doubt, _resolution
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm


@pytest.mark.parametrize(
    ("label", "value", "left", "half"),
    [
        ("coulomb_friction.a", 0.1, 0.2, 0.012),  # six tenths of what is left
        ("coulomb_friction.a", 0.1, 0.0, 0.0005),  # where nothing is, a two-hundredth
        ("position_gain.a", 2.0, 0.2, 0.12),  # of how far it is from 1,
        ("position_gain.a", np.exp(-4), 0.2, 0.48 * np.exp(-4)),  # or its logarithm from 0
        ("position_gain.a", 0.95, 0.2, 0.0095),  # no factor is known better than to a hundredth
    ],
)
def test_what_is_left_of_a_gap_leaves_values_open(
    label: str, value: float, left: float, half: float, tmp_path: Path
) -> None:
    """However many rows there are."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    option = next(option for option in candidates(data) if option.label == label)
    fit = Fit((option,), np.full((2, 1), value), np.zeros(2))
    assert _doubt(fit, np.array([left])) == pytest.approx([half])


def test_a_delay_is_known_to_a_millisecond(tmp_path: Path) -> None:
    """Commands have no stamps of their own, even where every reading has one."""
    log = arm.make_log(seconds=4.0)
    log = Log({**log.columns, **{f"stamp.{joint}": log.time for joint in "ab"}})
    data = arm.data_of(log, tmp_path)
    problem = Problem(data, Simulator(data, threads=1))
    delay = next(option for option in candidates(data) if option.label == "command_delay")
    assert problem.clock == pytest.approx(0.001)
    assert _resolution(problem, Fit((delay,), np.full((2, 1), 0.01), np.zeros(2))) == 0.001
    model = data.models[0]
    model.opt.timestep = 0.0005
    assert Problem(data, problem.simulator).clock == pytest.approx(0.00025)
    finest = _resolution(
        Problem(data, problem.simulator), Fit((delay,), np.zeros((2, 1)), np.zeros(2))
    )
    assert finest == 0.001
