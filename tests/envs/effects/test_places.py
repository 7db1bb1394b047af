"""Blocks of fields: slices where rows and columns allow it, and the same numbers either way."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.effects.places import block, spaced
from envs.plant import Plant

STEPS = 120
ARM = """<mujoco><option timestep="0.002"/><worldbody>
    <body name="one">
      <joint name="a" axis="0 1 0" armature="0.01" damping="0.02" frictionloss="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/>
      <body name="two" pos="0.2 0 0"><joint name="b" axis="0 1 0" armature="0.01" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.1"/></body></body>
  </worldbody><actuator>
    <position name="a" joint="a" kp="4" kv="0.1" forcerange="-1 1"/>
    <position name="b" joint="b" kp="3" kv="0.1" forcerange="-1 1" delay="0.006" nsample="5"/>
  </actuator></mujoco>"""
STEPPED = ["asymmetric_friction", "dead_zone", "actuator_lag", "integral_action"]
STEPPED += ["load_dependent_friction", "profile_acceleration", "profile_velocity", "cogging"]
STEPPED += ["stribeck_friction", "thermal_derating", "torque_speed_knee", "encoder_eccentricity"]


@pytest.mark.parametrize("index", [[3], [0, 1, 2], [1, 3, 5], [4, 2], [0, 1, 3], [2, 2], []])
def test_spaced_numbers_become_a_slice(index: list[int]) -> None:
    """It stands for the same numbers; what no slice stands for stays as it is."""
    numbers, every = np.array(index, int), np.arange(6)
    found = spaced(numbers)
    assert np.array_equal(every[found], numbers)
    assert isinstance(found, slice) == (index in ([3], [0, 1, 2], [1, 3, 5]))


@pytest.mark.parametrize("rows", [[0, 1], [1, 3], [0, 1, 3], [3, 0]])
@pytest.mark.parametrize("columns", [[2], [0, 1, 2], [0, 2], [0, 1, 4], [2, 1]])
def test_a_block_is_rows_by_columns(rows: list[int], columns: list[int]) -> None:
    """Whatever their spacing, in fields of any depth, and with a further index."""
    field = np.arange(4 * 5 * 3.0).reshape(4, 5, 3)
    own, places = np.ix_(rows, columns), block(np.array(rows), np.array(columns))
    assert np.array_equal(field[places], field[own])
    assert np.array_equal(field[(*places, 1)], field[(*own, 1)])
    assert np.array_equal(field[(*places, slice(2))], field[(*own, slice(2))])
    field[places] *= 2.0
    assert field.sum() == field[own].sum() / 2 + np.arange(60.0).sum()


@pytest.mark.parametrize("name", STEPPED)
def test_the_effects_below_act_before_substeps(name: str) -> None:
    """Else rows apart and side by side could not differ."""
    plant = Plant(mujoco.MjSpec.from_string(ARM), [make(name, where="a")], 1, 1)
    assert plant.substep_rules


@pytest.mark.parametrize("name", STEPPED)
@pytest.mark.parametrize("where", ["a", None])
def test_rows_apart_do_as_rows_side_by_side(name: str, where: str | None) -> None:
    """Rows 0, 1 and 4 of five, which are no slice, give every bit of rows 0, 1 and 2 of three."""
    apart, beside = np.array([0, 1, 4]), np.arange(3)
    path, same = (_path(name, where, rows, count) for rows, count in ((apart, 5), (beside, 3)))
    assert np.array_equal(path, same)
    without = _path(name, where, apart[:0], 5)
    assert np.abs(path - without[:, :1]).max() > 1e-6  # the effect does something


def _path(name: str, where: str | None, rows: np.ndarray, count: int) -> np.ndarray:
    """Return positions (STEPS, n, nq) of the rows (n,) that have an effect, among others without.

    Of all rows, where none has it.
    """
    effect = make(name, where=where)
    plant = Plant(mujoco.MjSpec.from_string(ARM), [effect], count, 1)
    low, high = effect.typical
    values = plant.space.points(count)
    values[rows, 0] = np.linspace(low + 0.2 * (high - low), high, len(rows))
    plant.set_params(np.arange(count), values)
    still = np.zeros((count, 2))
    plant.reset(np.arange(count), still, still, np.zeros(count, np.uint64), ctrl=still)
    found = []
    for step in range(STEPS):
        goal = 0.8 * np.sin(step // 15) * np.ones((count, 2))
        plant.step(None, goal, 2)
        seen = plant.measured(None)[0]
        found.append(seen[rows] if len(rows) else seen.copy())
    return np.array(found)
