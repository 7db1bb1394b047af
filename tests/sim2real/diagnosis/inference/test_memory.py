"""What effects remember at the start of a window, and no log tells."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects.friction import ViscousFriction
from envs.errors import EffectError
from sim2real.diagnosis.data.simulate import Run, Simulator
from sim2real.diagnosis.inference.candidates import candidates
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.replayer import Replayer
from tests.sim2real.diagnosis import arm


def _starts(effect: tuple[str, dict[str, Any], float], folder: Path) -> np.ndarray:
    """Return what effects remember changes in each window of a log with them, (W, N, M, K)."""
    name, arguments, value = effect
    data = arm.data_of(arm.make_log(effect, seconds=20.0), folder)
    member = next(c for c in candidates(data) if c.label.startswith(f"{name}.{arguments['where']}"))
    values = np.tile(member.neutral, (len(data.windows), 1))
    values[:, 0] = value
    return Replayer(data).starts(Hypothesis((member,)), values)[..., 4:]


def test_where_a_link_lies_within_a_play_is_unknown_at_every_start(tmp_path: Path) -> None:
    """Its motor is then elsewhere by up to the play, and what follows changes by about as much."""
    (ways,) = np.moveaxis(_starts(("backlash", {"where": "b"}, 0.1), tmp_path), -1, 0)
    size = np.abs(ways[..., 1]).max(axis=1)  # (W,)
    assert (size > 1e-4).mean() > 0.5
    assert size.max() < 0.1


def test_heat_is_unknown_the_more_the_hotter_a_motor_is(tmp_path: Path) -> None:
    """A log's first window starts cold; a part of the heat of the others is unknown."""
    (ways,) = np.moveaxis(_starts(("thermal_derating", {"where": "a"}, 0.04), tmp_path), -1, 0)
    size = np.sqrt(np.square(ways[..., 0]).mean(axis=1))
    assert size[0] == 0.0
    assert size[-3:].mean() > 3 * size[1:4].mean() > 0.0


@pytest.mark.parametrize("name", ["coulomb_friction", "viscous_friction"])
def test_what_remembers_nothing_adds_nothing(name: str, tmp_path: Path) -> None:
    """Positions and speeds are all that is unknown of a start."""
    assert _starts((name, {"where": "a"}, 0.02), tmp_path).shape[-1] == 0


def test_a_memory_that_nothing_keeps_is_refused(tmp_path: Path) -> None:
    """A user's effect that names a memory without a rule for it is no effect without memory."""
    data = arm.data_of(arm.make_log(seconds=8.0), tmp_path)
    run = Run((ViscousFriction(where="a"),), np.zeros(1, int), np.zeros((1, 1)), np.array(["oil"]))
    with pytest.raises(EffectError, match="no part of an effect has memory='oil'"):
        Simulator(data, threads=1).run_each([run])
