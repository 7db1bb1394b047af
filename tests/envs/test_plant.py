import warnings

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.effects.base import Effect
from envs.effects.bound import BoundEffect, SubstepRule
from envs.errors import EffectError, ParameterError, TaskError
from envs.params import Parameter
from envs.plant import Plant
from envs.simulation import Simulation
from envs.tasks import Hopper

ARM = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody><body name="link">
  <joint name="hinge" axis="0 1 0" damping="0.1"/>
  <geom name="rod" type="capsule" size="0.01" fromto="0 0 0 0.2 0 0" mass="0.5"/></body></worldbody>
  <actuator><position name="servo" joint="hinge" kp="5" kv="0.2"/></actuator></mujoco>"""


def plant(effects=(), rows: int = 1, **arguments) -> Plant:
    """Return an arm with one servo."""
    return Plant(mujoco.MjSpec.from_string(ARM), effects, rows, 1, **arguments)


def test_it_steps_as_plain_mujoco_to_the_bit() -> None:
    """Without effects a row is one MjData, stepped with the same controls."""
    arm = plant()
    arm.reset(np.arange(1), np.array([[0.3]]), np.array([[-1.0]]), np.zeros(1, np.uint64))
    data = mujoco.MjData(arm.nominal)
    data.qpos[:], data.qvel[:] = 0.3, -1.0
    for t in range(50):
        arm.step(None, np.array([[0.1 * t]]), 4)
        data.ctrl[:] = 0.1 * t
        mujoco.mj_step(arm.nominal, data, 4)
    assert arm.qpos[0] == data.qpos
    assert arm.qvel[0] == data.qvel


def test_the_given_spec_is_left_alone() -> None:
    """Structural effects edit a copy."""
    spec = mujoco.MjSpec.from_string(ARM)
    before = spec.to_xml()
    made = Plant(spec, [make("backlash", where="hinge"), make("command_delay")], 1, 1)
    assert spec.to_xml() == before
    assert (made.nominal.njnt, made.model.njnt) == (1, 2)


def test_a_compiled_model_is_kept_and_not_changed() -> None:
    """Given or compiled, edited by an effect or not, plants step alike to the bit."""
    spec = Hopper().spec()
    given = spec.copy().compile()
    before = np.concatenate([given.body_mass, given.dof_damping, given.actuator_gear[:, 0]])
    some = [make("link_mass", where="torso", how="scale")]
    for effects, edited in ((some, False), ([*some, make("backlash", where="foot_joint")], True)):
        assert any(effect.edits for effect in effects) is edited
        paths = []
        for nominal in (None, given):
            one = Plant(spec, effects, nominal=nominal)
            values = np.concatenate([[[1.4]], one.space.neutral[None, 1:]], axis=1)
            one.set_params(np.array([0]), values)
            one.reset(np.array([0]), given.qpos0[None], np.zeros((1, given.nv)), np.array([0]))
            for _ in range(20):
                one.step(None, np.full((1, given.nu), 0.3), 4)
            paths.append(one.qpos.copy())
        np.testing.assert_array_equal(*paths)
        assert abs(paths[0] - given.qpos0).max() > 0.01
    after = np.concatenate([given.body_mass, given.dof_damping, given.actuator_gear[:, 0]])
    np.testing.assert_array_equal(before, after)


def test_values_are_written_from_the_models_own() -> None:
    """A second draw replaces the first, whatever the way; neutral values restore the model."""
    for how, value in (("add", 0.2), ("scale", 1.5), ("set", 0.9)):
        arm = plant([make("link_mass", where="link", how=how)], 2)
        neutral = arm.params.copy()
        for _ in range(2):
            arm.set_params(np.array([1]), np.array([[value]]))
        expected = {"add": 0.7, "scale": 0.75, "set": 0.9}[how]
        assert arm.field("body_mass")[:, 1] == pytest.approx([0.5, expected])
        arm.set_params(np.arange(2), neutral)
        assert (arm.field("body_mass")[:, 1] == arm.nominal.body_mass[1]).all()


def test_derived_constants_follow() -> None:
    """The engine's constants are those of a model compiled with the value."""
    arm = plant([make("armature", where="hinge")])
    arm.set_params(np.arange(1), np.array([[0.02]]))
    spec = mujoco.MjSpec.from_string(ARM)
    spec.joint("hinge").armature = 0.02
    assert arm.batch.get_model(0).dof_invweight0 == pytest.approx(spec.compile().dof_invweight0)


def test_effects_on_one_field_compose_in_order() -> None:
    """Each adds to or scales what those before it left."""
    effects = [
        make("motor_strength", where="servo"),
        make("position_gain", where="servo"),
        make("supply_voltage"),
        make("thermal_derating", where="servo"),
    ]
    arm = plant(effects)
    arm.set_params(np.arange(1), np.array([[0.5, 0.6, 0.7, 0.0]]))
    arm.reset(np.arange(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, np.uint64))
    force = arm.batch.bind("actuator_force")
    arm.step(None, np.array([[1.0]]), 1)
    assert force[0, 0] == pytest.approx(5 * 0.5 * 0.6 * 0.7)


def test_fixed_effects_come_first_and_are_no_parameters() -> None:
    """A drawn value is added to, or multiplies, the fixed one."""
    fixed = [(make("link_mass", where="link"), (0.1,))]
    for how, value, mass in (("add", 0.2, 0.8), ("scale", 2.0, 1.2)):
        arm = plant([make("link_mass", where="link", how=how)], 2, fixed=fixed)
        assert arm.space.names == ("link_mass.link",)
        arm.set_params(np.arange(2), np.full((2, 1), value))
        assert arm.field("body_mass")[:, 1] == pytest.approx(mass)
    alone = plant(fixed=fixed)
    assert alone.space.size == 0
    assert alone.field("body_mass")[0, 1] == pytest.approx(0.6)


def test_fixed_and_drawn_that_do_not_compose_are_refused() -> None:
    """Setting over a fixed value, or one play inside another, is an error with its remedy."""
    with pytest.raises(
        EffectError, match=r"link_mass.link is both fixed and drawn.*how: add or scale"
    ):
        fixed = [(make("link_mass", where="link"), (0.1,))]
        plant([make("link_mass", where="link", how="set")], fixed=fixed)
    with pytest.raises(
        EffectError, match=r"backlash.hinge is both fixed and drawn.*remove it from one"
    ):
        fixed = [(make("backlash", where="hinge"), (0.1,))]
        plant([make("backlash", where="hinge")], fixed=fixed)
    with pytest.raises(EffectError, match=r"backlash.hinge is fixed twice"):
        plant(fixed=[*fixed, *fixed])


def test_a_fixed_value_outside_its_range_is_refused() -> None:
    """The message names effect, value and range."""
    with pytest.raises(ParameterError, match=r"backlash.hinge = -0.1 rad .* outside \[0, inf\]"):
        plant(fixed=[(make("backlash", where="hinge"), (-0.1,))])
    with pytest.raises(ParameterError, match="must have shape"):
        plant(fixed=[(make("gravity_tilt"), (0.1,))])


def test_two_drawn_effects_of_one_name_are_refused() -> None:
    """A parameter has one name."""
    with pytest.raises(ParameterError, match=r"'link_mass.link' is given twice"):
        plant([make("link_mass", where="link"), make("link_mass", where="link", how="scale")])


class Push(Effect):
    """A constant torque: the smallest substep rule."""

    name, place, unit = "push", "joint", "N·m"

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the torque."""
        return (self.parameter(),)

    def bind(self, plant: Plant) -> BoundEffect:
        """Push before each substep."""
        return Pushing(plant)


class Pushing(SubstepRule):
    """Adds its torque to whatever is applied."""

    def __init__(self, plant: Plant) -> None:
        self.applied, self.value = plant.applied, np.zeros(plant.num_rows)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Keep the torque of each row."""
        self.value[ids] = values[:, 0]

    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Push."""
        self.applied[ids, 0] += self.value[ids]


def test_torques_of_several_rules_add_up() -> None:
    """The plant zeroes the applied forces once a substep, and each rule adds its own."""
    effects = [Push("hinge"), make("cogging", where="hinge", count=0.0, phase=np.pi / 2)]
    arm = plant(effects, 3)
    arm.set_params(np.arange(3), np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.1]]))
    arm.reset(np.arange(3), np.zeros((3, 1)), np.zeros((3, 1)), np.zeros(3, np.uint64))
    arm.step(None, np.zeros((3, 1)), 5)
    assert arm.applied[:, 0] == pytest.approx([0.0, 0.2, 0.3])
    arm.reset(np.arange(3), np.zeros((3, 1)), np.zeros((3, 1)), np.zeros(3, np.uint64))
    assert (arm.applied == 0).all()


def test_rules_are_asked_only_where_their_effect_is_there() -> None:
    """A row at the neutral value costs nothing; with or without a selection of rows."""
    asked: list[list[int]] = []

    class Watched(Pushing):
        def before_substep(self, ids: np.ndarray | slice) -> None:
            asked.append(np.arange(4)[ids].tolist())
            super().before_substep(ids)

    class WatchedPush(Push):
        def bind(self, plant: Plant) -> SubstepRule:
            return Watched(plant)

    arm, ids = plant([WatchedPush("hinge")], 4), np.arange(4)
    for values, rows, expected in (
        ([0.0, 0.0, 0.0, 0.0], None, []),
        ([0.0, 0.2, 0.0, 0.1], None, [1, 3]),
        ([0.0, 0.2, 0.0, 0.1], np.array([0, 2, 3]), [3]),
        ([0.3, 0.2, 0.1, 0.1], np.array([0, 2]), [0, 2]),
    ):
        arm.set_params(ids, np.array(values)[:, None])
        arm.reset(ids, np.zeros((4, 1)), np.zeros((4, 1)), np.zeros(4, np.uint64))
        asked.clear()
        arm.step(rows, np.zeros((4 if rows is None else len(rows), 1)), 2)
        assert asked == ([expected] * 2 if expected else [])
        chosen = ids if rows is None else rows
        assert arm.applied[chosen, 0] == pytest.approx(np.array(values)[chosen])


def test_it_needs_a_row() -> None:
    """A plant of no simulations is an error."""
    with pytest.raises(TaskError, match="num_rows=0"):
        plant(rows=0)


def test_effects_work_under_a_task() -> None:
    """A Hopper with play, delay, noise and friction runs; fixed effects change no parameter."""
    effects = [
        make("backlash", where="foot_joint"),
        make("command_delay"),
        make("load_dependent_friction"),
        make("sensor_noise"),
    ]
    fixed = [(make("link_mass", where="torso"), (0.5,))]
    n = 4
    simulation = Simulation(Hopper(), n, effects, threads=1, fixed=fixed)
    plain = Simulation(Hopper(), n, threads=1)
    ids, seeds = np.arange(n), np.arange(n, dtype=np.uint64)
    neutral = simulation.space.points(n)
    action = np.random.default_rng(0).uniform(-1, 1, (10, n, 3))
    first = simulation.reset(ids, neutral, seeds)
    assert first == pytest.approx(plain.reset(ids, plain.space.points(n), seeds), abs=1e-9)
    values = neutral + np.array([0.03, 0.01, 0.1, 0.01])
    simulation.reset(ids, values, seeds)
    for a in action:
        step = simulation.step(None, a)
        assert not step.failed.any()
        assert step.observation.shape == (n, 11)
    assert simulation.plant.qpos.shape == (n, 6)
    assert simulation.plant.model.body_mass[1] == plain.plant.model.body_mass[1]
    assert simulation.plant.field("body_mass")[:, 1] == pytest.approx(
        plain.plant.model.body_mass[1] + 0.5
    )


def test_a_broken_row_leaves_the_others_alone() -> None:
    """A diverged row among structured ones with rules is reported, and resets cleanly."""
    effects = [make("joint_compliance", where="hinge"), make("stribeck_friction", where="hinge")]
    arm, clean = plant(effects, 3), plant(effects, 3)
    values = np.tile([0.1, 0.01], (3, 1))
    ids, seeds = np.arange(3), np.zeros(3, np.uint64)
    for p in (arm, clean):
        p.set_params(ids, values)
        p.reset(ids, np.full((3, 1), 0.1), np.zeros((3, 1)), seeds)
    arm.layout.raw_qvel[1] = 1e12
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        failed = arm.step(None, np.zeros((3, 1)), 4)
    clean.step(None, np.zeros((3, 1)), 4)
    assert list(failed) == [False, True, False]
    assert (arm.qpos[[0, 2]] == clean.qpos[[0, 2]]).all()
    arm.reset(np.array([1]), np.full((1, 1), 0.1), np.zeros((1, 1)), seeds[:1])
    assert not arm.step(np.array([1]), np.zeros((1, 1)), 4).any()
    assert arm.qpos[1] == clean.qpos[1]


def test_a_model_that_sleeps_is_simulated_awake() -> None:
    """Sleeping remembers more than a state; what else does is refused by its name."""
    asleep = ARM.replace("/><worldbody>", '><flag sleep="enable"/></option><worldbody>')
    paths = []
    for text in (asleep, ARM):
        rows = Plant(mujoco.MjSpec.from_string(text), (), 2, 1)
        rows.reset(np.arange(2), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros(2, np.uint64))
        rows.step(None, np.full((2, 1), 0.5), 50)
        paths.append(rows.qpos.copy())
    assert np.array_equal(*paths)
    other = asleep.replace("sleep", "ipc").replace("<option", '<option integrator="discrete"')
    with pytest.raises(TaskError, match=r'<flag ipc="enable"/>, whose contacts have'):
        Plant(mujoco.MjSpec.from_string(other), (), 2, 1)
