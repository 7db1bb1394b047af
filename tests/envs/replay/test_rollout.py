"""Rolling a plant's rows in one call is stepping it."""

import mujoco
import numpy as np
import pytest

from envs.effects import EFFECTS as LIBRARY
from envs.effects import make
from envs.plant import Plant
from envs.replay import rollout, switchable

ARM = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper"><joint name="a" axis="0 1 0" armature="0.01" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      <body name="lower" pos="0 0 -0.2">
        <joint name="b" axis="0 1 0" armature="0.01" damping="0.02"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="a" kp="8" kv="0.3" forcerange="-3 3"/>
    <position name="b" joint="b" kp="6" kv="0.3" forcerange="-3 3"/>
  </actuator>
</mujoco>
"""
ROWS, STEPS = 3, 150
EFFECTS = [
    ("coulomb_friction", {"where": "a"}, 0.05),
    ("encoder_offset", {"where": "b"}, 0.03),
    ("command_delay", {}, 0.01),
    ("backlash", {"where": "a", "side": "motor"}, 0.03),
    ("backlash", {"where": "a", "side": "link"}, 0.03),
    ("stribeck_friction", {"where": "b"}, 0.08),
    ("observation_delay", {}, 0.0137),
]


def plant(*effects: tuple[str, dict, float]) -> Plant:
    """Return rows of the arm, each effect at a third, two thirds and all of its value."""
    made = [make(name, **arguments) for name, arguments, _ in effects]
    rows = Plant(switchable(mujoco.MjSpec.from_string(ARM)), made, ROWS, threads=1)
    values = np.outer(np.arange(1, ROWS + 1) / ROWS, [value for *_, value in effects])
    every = np.arange(ROWS)
    rows.set_params(every, values)
    start = np.tile([0.2, -0.1], (ROWS, 1))
    held = np.zeros((ROWS, 2))
    rows.reset(every, start, np.zeros((ROWS, 2)), np.zeros(ROWS, np.uint64), held, measured=True)
    return rows


def commands() -> np.ndarray:
    """Return steps of two sizes, held for 20 physics steps, (ROWS, STEPS, 2)."""
    levels = np.random.default_rng(0).uniform(-0.6, 0.6, (ROWS, STEPS // 20 + 1, 2))
    return levels.repeat(20, axis=1)[:, :STEPS]


def stepped(rows: Plant, ctrl: np.ndarray) -> np.ndarray:
    """Return what the encoders say when the plant is stepped."""
    paths = [rows.measured(None)[0].copy()]
    for step in range(ctrl.shape[1]):
        assert not rows.step(None, ctrl[:, step], 1).any()
        paths.append(rows.measured(None)[0].copy())
    return np.stack(paths, axis=1)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: f"{e[0]}-{e[1].get('side', '')}")
def test_rolling_is_stepping(effect: tuple[str, dict, float]) -> None:
    """One call of the engine gives the positions that a call for each step gives."""
    ctrl = commands()
    assert rollout(plant(effect), ctrl) == pytest.approx(stepped(plant(effect), ctrl), abs=1e-9)


@pytest.mark.parametrize("side", ["motor", "link"])
def test_rolling_is_stepping_for_several_at_once(side: str) -> None:
    """Also where an encoder is late, has a wrong zero and sits on one side of a spring."""
    several = [
        ("observation_delay", {}, 0.0137),
        ("encoder_offset", {"where": "a"}, 0.05),
        ("joint_compliance", {"where": "a", "side": side}, 0.1),
    ]
    ctrl = commands()
    assert rollout(plant(*several), ctrl) == pytest.approx(stepped(plant(*several), ctrl), abs=1e-9)


def test_a_late_encoder_reads_the_past() -> None:
    """Under an observation delay the path is the one without it, later."""
    ctrl = commands()
    late = rollout(plant(("observation_delay", {}, 0.03)), ctrl)
    plain = rollout(plant(), ctrl)
    shift = 15  # steps of 2 ms, in the last row
    assert late[-1, shift:] == pytest.approx(plain[-1, : STEPS + 1 - shift], abs=1e-9)
    assert late[-1, :shift] == pytest.approx(np.tile(plain[-1, 0], (shift, 1)), abs=1e-9)


def test_a_servo_that_is_off_lets_go_and_takes_hold_again() -> None:
    """While off it does not resist; rows that are on do not notice; the plant is as it was."""
    ctrl = commands()
    off = np.zeros((ROWS, STEPS), np.int64)
    off[0, 40:80] = 0b11
    rows = plant()
    switched, plain = rollout(rows, ctrl, off), rollout(plant(), ctrl)
    assert switched[1:] == pytest.approx(plain[1:], abs=1e-12)
    assert np.abs(switched[0, 80] - plain[0, 80]).max() > 0.02
    assert not np.any(rows.batch.expanded("opt.disableactuator"))


DRIVES = {
    "position_gain": 0.5, "derivative_gain": 3.0, "motor_strength": 0.5, "torque_limit": 0.5,
    "dead_zone": 0.1, "torque_speed_knee": 0.5, "actuator_lag": 0.02, "integral_action": 5.0,
    "thermal_derating": 0.5, "profile_velocity": 0.5, "profile_acceleration": 2.0,
    "command_delay": 0.01,
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(DRIVES))
def test_what_is_in_a_drive_does_nothing_while_it_is_off(name: str) -> None:
    """The engine's clamp acts on an actuator that is off: a lagging torque once pushed on."""
    off = np.full((ROWS, STEPS), 0b11, np.int64)
    off[:, 120:] = 0
    changed, free = (
        rollout(plant((name, {}, DRIVES[name])), commands(), off),
        rollout(plant(), commands(), off),
    )
    np.testing.assert_array_equal(changed[:, :121], free[:, :121])
    assert np.abs(changed - free).max() > 1e-4  # and something afterwards


def test_every_effect_of_a_drive_was_looked_at_off() -> None:
    """A new one belongs into DRIVES."""
    drives = {name for name, effect in LIBRARY.items() if effect.place == "actuator"}
    assert drives <= set(DRIVES)


def test_a_servo_that_is_off_does_not_brake_where_heat_could_weaken_it() -> None:
    """Its windings carry nothing: no friction follows their drag, derated or not."""
    spec = switchable(mujoco.MjSpec.from_string(ARM.replace("kv=", "damping=")))
    off = np.zeros((ROWS, STEPS), np.int64)
    off[:, 40:120] = 0b11
    rubs = make("load_dependent_friction", where="b", external=0.0)
    every, start, paths = np.arange(ROWS), np.zeros((ROWS, 2)), []
    for absent in ([], [make("thermal_derating", where="b")]):
        rows = Plant(spec, [rubs, *absent], ROWS, threads=1)
        rows.set_params(every, np.tile([0.5, 0.0][: 1 + len(absent)], (ROWS, 1)))
        rows.reset(every, start, start, every.astype(np.uint64), commands()[:, 0])
        paths.append(rollout(rows, commands(), off))
    assert paths[1] == pytest.approx(paths[0], abs=1e-12)


@pytest.mark.parametrize("more", [(), (("stribeck_friction", {"where": "b"}, 0.01),)])
def test_a_row_that_diverges_is_told_apart(more: tuple[tuple[str, dict, float], ...]) -> None:
    """Its positions are NaN from where it broke; the others are untouched."""
    strong = ("motor_strength", {"where": "a"}, 1.0)
    rows = plant(strong, *more)
    values = rows.params.copy()
    values[1, 0] = 1e9
    rows.set_params(np.arange(ROWS), values)
    paths, plain = rollout(rows, commands()), rollout(plant(strong, *more), commands())
    broke = np.isnan(paths[1]).any(axis=1)
    assert np.flatnonzero(broke)[0] in range(1, 10)
    assert broke[np.flatnonzero(broke)[0] :].all()
    assert np.array_equal(paths[[0, 2]], plain[[0, 2]])


def test_a_row_breaks_at_the_same_step_in_one_call_and_in_many() -> None:
    """However the steps are taken, a simulation that diverges is lost at the same moment."""
    strong, late = ("motor_strength", {"where": "a"}, 1.0), ("stribeck_friction", {"where": "b"}, 0)
    moments = []
    for effects in ([strong], [strong, late]):
        rows = plant(*effects)
        values = rows.params.copy()
        values[:, 0] = [300.0, 1e3, 1e5]
        rows.set_params(np.arange(ROWS), values)
        moments.append(np.isnan(rollout(rows, commands())).any(axis=2).sum(axis=1))
    assert moments[0].tolist() == moments[1].tolist()
    assert moments[0].any()


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: f"{e[0]}-{e[1].get('side', '')}")
def test_a_row_is_simulated_to_its_end_and_no_further(effect: tuple[str, dict, float]) -> None:
    """Up to the end of each row the positions are those of a full run; then they stand still."""
    ctrl, ends = commands(), np.array([60, STEPS, 101])
    off = np.zeros((ROWS, STEPS), np.int64)
    off[0, 30:80] = 0b01
    full, short = rollout(plant(effect), ctrl, off), rollout(plant(effect), ctrl, off, steps=ends)
    for row, end in enumerate(ends):
        assert np.array_equal(short[row, : end + 1], full[row, : end + 1])
    assert np.ptp(full[0, 60:], axis=0).max() > 1e-3
    late = 8  # steps until the late encoder has seen the end as well
    assert np.ptp(short[0, 60 + late :], axis=0).max() == 0.0


def test_no_step_is_taken_beyond_the_end_of_a_row() -> None:
    """The clock of each simulation stands where its row ends."""
    ends, dt = np.array([60, STEPS, 101]), 0.002
    for effects in ((), (("stribeck_friction", {"where": "b"}, 0.08),)):
        rows = plant(*effects)
        rollout(rows, commands(), steps=ends)
        assert rows.time == pytest.approx(ends * dt)
