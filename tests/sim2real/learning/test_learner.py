"""Making an algorithm's environment, with and without effects from a file."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from envs import Hopper, Simulation
from envs.errors import EffectError
from envs.toys import Nav2D
from sim2real.config.compose import compose, prepare
from sim2real.learning.learner import build, with_effects
from sim2real.runs.errors import Sim2RealError


def test_effects_of_a_file_change_the_simulator(tmp_path: Path) -> None:
    """A kilogram in effects.yaml is a kilogram in every row of the environment."""
    path = tmp_path / "effects.yaml"
    path.write_text("- {effect: link_mass, where: torso, value: 1.0}\n", encoding="utf-8")
    rows = cast(Simulation, with_effects(partial(Simulation, Hopper()), path)(num_rows=3))
    plain = cast(Simulation, with_effects(partial(Simulation, Hopper()), None)(num_rows=3))
    torso = plain.plant.model.body("torso").id
    masses = rows.plant.batch.expand("body_mass")[:, torso]
    np.testing.assert_allclose(masses, plain.plant.model.body_mass[torso] + 1.0)


def test_effects_need_a_robot(tmp_path: Path) -> None:
    """A point in the plane has no torso to load, and a missing file is named before work starts."""
    path = tmp_path / "effects.yaml"
    path.write_text("[]", encoding="utf-8")
    with pytest.raises(Sim2RealError, match="Nav2D simulates no robot"):
        with_effects(Nav2D, path)
    with pytest.raises(EffectError, match=r"missing\.yaml"):
        with_effects(partial(Simulation, Hopper()), tmp_path / "missing.yaml")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["algorithm=ppo", "adapt=hillclimb"], "PPO trains no policy that adapts; use adapt=none"),
        (["policy=actor_critic"], "ActorCritic is none; use policy=linear or policy=mlp"),
    ],
)
def test_parts_that_do_not_go_together_are_refused(
    words: list[str], sentence: str, tmp_path: Path
) -> None:
    """A way to adapt for a policy that cannot, and a network that evolution cannot search."""
    _, given = prepare(compose(["env=nav2d", "params=goals", *words]), tmp_path)
    parts = {name: given[name] for name in ("env", "policy", "adapt", "device")}
    with pytest.raises(Sim2RealError, match=sentence):
        build(given["algorithm"], **parts, tasks=given["params"], seed=0)
