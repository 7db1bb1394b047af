import re

import mujoco
import numpy as np
import pytest

from envs.effects import EFFECTS, Effect, FieldEffect, make, register
from envs.effects.table import pages
from envs.errors import EffectError, ParameterError
from envs.plant import Plant
from envs.randomization import Draw, Randomization

STANDARD = [
    *("coulomb_friction", "viscous_friction", "stribeck_friction", "load_dependent_friction"),
    *("backlash", "joint_compliance", "cogging", "armature", "position_gain", "derivative_gain"),
    *("motor_strength", "torque_limit", "supply_voltage", "thermal_derating", "profile_velocity"),
    *("command_delay", "observation_delay", "encoder_offset", "link_mass", "center_of_mass"),
    *("payload", "gravity_tilt", "ground_friction", "contact_stiffness", "velocity_filter"),
    *("sensor_noise", "quantization", "packet_loss", "supply_sag", "dead_zone"),
    *("profile_acceleration", "asymmetric_friction", "torque_speed_knee", "actuator_lag"),
    *("integral_action", "link_inertia", "link_length", "surface_friction", "restitution"),
    *("hysteretic_compliance", "encoder_eccentricity", "clock_drift"),
]

ARM = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
    <light dir="0 0 -1"/>
    <camera name="side" pos="0 -1 0" xyaxes="1 0 0 0 0 1"/>
  <geom name="floor" type="plane" size="1 1 0.1" pos="0 0 -0.12"/>
  <body name="upper"><joint name="shoulder" axis="0 1 0" armature="0.01" damping="0.05"
    frictionloss="0.002"/>
    <geom type="capsule" size="0.01" fromto="0 0 0 0.1 0 0" mass="0.1"/>
    <body name="lower" pos="0.1 0 0"><joint name="elbow" axis="0 1 0" armature="0.005"/>
      <geom name="foot" type="capsule" size="0.01" fromto="0 0 0 0.1 0 0.02" mass="0.1"/>
  </body></body></worldbody>
  <actuator><position name="a" joint="shoulder" kp="3" kv="0.1" forcerange="-1 1" damping="0.02"/>
  <position name="b" joint="elbow" kp="2" kv="0.05" forcerange="-1 1"/></actuator></mujoco>"""
PLACES = {"joint": "shoulder", "actuator": "b", "body": "lower", "contact": "foot", "robot": None}
NEEDED = {"supply_sag": {"voltage": 5.0, "torque_constant": 0.35}}


def effect(name: str, **arguments) -> Effect:
    """Make an effect at its place on the arm."""
    where = arguments.pop("where", PLACES[EFFECTS[name].place])
    return make(name, where=where, **NEEDED.get(name, {}), **arguments)


def arm() -> mujoco.MjSpec:
    """Return an arm of two links that can reach a floor."""
    return mujoco.MjSpec.from_string(ARM)


def drive(effects: list, values: np.ndarray | None = None, rows: int = 2) -> np.ndarray:
    """Return true and measured states of an arm that hits the floor, (T, rows, 8)."""
    plant = Plant(arm(), effects, rows, 1)
    ids = np.arange(rows)
    if values is not None:
        plant.set_params(ids, values)
    start = np.tile([0.1, 0.2], (rows, 1))
    plant.reset(ids, start, np.zeros((rows, 2)), np.full(rows, 5, np.uint64))
    states = []
    for t in range(80):
        command = [0.7 + 0.6 * np.sin(0.3 * t), 0.5 * np.sin(0.2 * t)]
        assert not plant.step(None, np.tile(command, (rows, 1)), 5).any()
        states.append(np.concatenate([plant.qpos, plant.qvel, *plant.measured(None)], axis=1))
    return np.array(states)


@pytest.fixture(scope="module")
def plain() -> np.ndarray:
    """The arm without any effect."""
    return drive([])


def variants() -> list:
    """Every effect in every way and on every side, at one place and at all of them."""
    found = []
    for name, kind in EFFECTS.items():
        if name == "goal":
            continue  # no robot has it: tests/envs/tasks/test_goals.py
        if name in ("imu_mounting", "imu_delay", "gyro_bias", "gyro_scale"):
            continue  # no arm has an IMU: test_imu.py
        places = {PLACES[kind.place], None} - ({None} if kind.place == "body" else set())
        for where in sorted(places, key=str):
            found += [(name, where, how, None) for how in kind.hows]
            found += [(name, where, kind.hows[0], side) for side in kind.sides[1:]]
    return found


def test_the_vocabulary_is_whole() -> None:
    """Every standard name is there."""
    assert set(STANDARD) <= set(EFFECTS)


@pytest.mark.parametrize(("name", "where", "how", "side"), variants())
def test_a_neutral_effect_is_absent(name, where, how, side, plain) -> None:
    """At its neutral values a plant is the one without the effect, bit for bit."""
    states = drive([effect(name, where=where, how=how, side=side)])
    if name in ("backlash", "joint_compliance", "hysteretic_compliance"):
        assert np.abs(states - plain).max() < 1e-12
    else:
        assert (states == plain).all()


@pytest.mark.parametrize("name", STANDARD)
def test_an_effect_acts_and_rows_differ(name, plain) -> None:
    """A typical value changes what is true or measured, in its own row alone."""
    value = 0.15 if name == "torque_limit" else EFFECTS[name].typical[1]
    if name in ("profile_velocity", "profile_acceleration", "torque_speed_knee"):
        value = EFFECTS[name].typical[0]
    made = effect(name, where=None if name == "thermal_derating" else PLACES[EFFECTS[name].place])
    neutral = Plant(arm(), [made], 1, 1).space.neutral
    states = drive([made], np.stack([neutral, np.full_like(neutral, value)]))
    assert np.abs(states[:, 0] - plain[:, 0]).max() < 1e-12
    assert np.abs(states[:, 1] - plain[:, 1]).max() > 1e-5


@pytest.mark.parametrize("name", STANDARD)
def test_a_row_does_not_depend_on_where_it_runs(name) -> None:
    """The same values and seed give the same bits in another row, and stepped as a subset."""
    made = effect(name)
    neutral = Plant(arm(), [made], 1, 1).space.neutral
    value = np.full_like(neutral, EFFECTS[name].typical[1])
    alone = drive([made], value[None], rows=1)
    beside = drive([made], np.stack([neutral, value, neutral]), rows=3)
    assert (alone[:, 0] == beside[:, 1]).all()

    plant = Plant(arm(), [made], 3, 1)
    plant.set_params(np.array([1]), value[None])
    ids, one = np.array([1]), np.array([5], np.uint64)
    plant.reset(ids, np.array([[0.1, 0.2]]), np.zeros((1, 2)), one)
    for t in range(80):
        command = np.array([[0.7 + 0.6 * np.sin(0.3 * t), 0.5 * np.sin(0.2 * t)]])
        plant.step(ids, command, 5)
        state = np.concatenate([plant.qpos[ids], plant.qvel[ids], *plant.measured(ids)], axis=1)
        assert (state == alone[t]).all()


@pytest.mark.parametrize("name", STANDARD)
def test_an_episode_does_not_remember_the_one_before(name) -> None:
    """A row that is reset repeats its episode to the bit."""
    made = effect(name)
    plant = Plant(arm(), [made], 1, 1)
    value = np.full_like(plant.space.neutral, EFFECTS[name].typical[1])
    runs = []
    for _ in range(2):
        plant.set_params(np.arange(1), value[None])
        seed = np.array([5], np.uint64)
        plant.reset(np.arange(1), np.array([[0.1, 0.2]]), np.zeros((1, 2)), seed)
        for t in range(30):
            plant.step(None, np.array([[0.7, 0.02 * t]]), 5)
        runs.append(np.concatenate([plant.qpos, plant.qvel, *plant.measured(None)], axis=1))
    assert (runs[0] == runs[1]).all()


@pytest.mark.parametrize("name", STANDARD)
def test_each_effect_says_what_it_is(name) -> None:
    """Each has a unit, a range of typical values, and its three sentences."""
    kind = EFFECTS[name]
    assert kind.__doc__
    assert isinstance(kind.unit, str)
    assert kind.typical[0] < kind.typical[1]
    for text in (kind.symptom, kind.source, kind.experiment):
        assert len(text) > 15
        assert not text.endswith(".")


def test_an_unknown_effect_is_refused_with_the_nearest() -> None:
    """All names are listed."""
    with pytest.raises(EffectError, match=r"no effect 'backlsh' \(did you mean 'backlash'\?\)"):
        make("backlsh")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"name": "link_mass"}, "needs where: the name of a body"),
        ({"name": "command_delay", "where": "elbow"}, "acts on the whole robot; leave out where"),
        ({"name": "backlash", "how": "scale"}, "cannot 'scale' a value; it can: add"),
        ({"name": "cogging", "side": "motor"}, "it has no sides"),
        ({"name": "cogging", "counts": 3}, "no extra 'counts'.*did you mean 'count'"),
        ({"name": "cogging", "count": "many"}, "count='many' 1/turn is outside"),
        ({"name": "cogging", "free": ("speed",)}, "no extra 'speed'"),
        ({"name": "stribeck_friction", "speed": 0.0}, "speed=0.0 rad/s is outside"),
        ({"name": "supply_voltage", "drive": "steam"}, "drive='steam' is unknown"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message) -> None:
    """Each error names effect, value and what is allowed."""
    with pytest.raises(EffectError, match=message):
        make(**arguments)


def test_an_effect_of_ones_own_is_known_everywhere(tmp_path) -> None:
    """One class, registered once: `make`, randomization and effects.yaml take it."""
    from envs.effects.file import load_effects, write_effects

    class SpringStiffness(FieldEffect):
        """The stiffness of a joint's spring."""

        name, place, unit = "spring_stiffness", "joint", "N·m/rad"
        hows = ("add", "scale")
        field = "jnt_stiffness"
        symptom = "the joint is pulled to its rest angle"
        source = "MuJoCo XML reference, joint/stiffness"
        experiment = "let go of the joint from several angles"

    register(SpringStiffness)
    try:
        own = make("spring_stiffness", where="elbow")
        tasks = Randomization([Draw(own, low=0.5, high=1.0)])
        plant = Plant(arm(), tasks.effects, 4, 1)
        tasks.check(plant.space)
        values = tasks.sample(np.random.default_rng(0), 4)
        plant.set_params(np.arange(4), values)
        assert (plant.field("jnt_stiffness")[:, 1] == values[:, 0]).all()
        path = tmp_path / "effects.yaml"
        write_effects(path, [(own, (0.7,))])
        fixed = Plant(arm(), fixed=load_effects(path))
        assert fixed.field("jnt_stiffness")[0, 1] == 0.7
        with pytest.raises(EffectError, match="'spring_stiffness' is already"):
            register(type("Other", (SpringStiffness,), {"__module__": "elsewhere"}))
    finally:
        del EFFECTS["spring_stiffness"]


def test_values_outside_their_range_are_refused_before_anything_is_written() -> None:
    """The message names parameter, value, row and range; the rows stay as they were."""
    plant = Plant(arm(), [effect("backlash")], 2, 1)
    plant.set_params(np.arange(2), np.array([[0.01], [0.02]]))
    with pytest.raises(ParameterError, match=r"backlash.shoulder = -0.1 rad \(row 1\)"):
        plant.set_params(np.arange(2), np.array([[0.03], [-0.1]]))
    assert plant.params[:, 0] == pytest.approx([0.01, 0.02])


def test_every_effect_has_a_section_on_one_page() -> None:
    """The pages are those of the places; tests/test_docs.py compares the files with them."""
    text = "".join(text for name, text in pages().items() if name != "index.md")
    assert sorted(re.findall(r"^## (\w+)$", text, re.MULTILINE)) == sorted(EFFECTS)


def test_a_factor_on_nothing_is_refused() -> None:
    """A model without friction there cannot have more of it by a factor."""
    with pytest.raises(EffectError, match=r"coulomb_friction\.elbow.*is 0 there.*how: add"):
        Plant(arm(), [make("coulomb_friction", where="elbow", how="scale")], 1, 1)


def test_a_user_s_effect_may_set_attributes_by_their_older_names() -> None:
    """They count as the present ones, with a warning, for one minor release."""
    with pytest.warns(DeprecationWarning, match="display_name"):
        own = type("Own", (EFFECTS["coulomb_friction"],), {"words": "friction of my own"})
    assert own.in_words() == "friction of my own"
