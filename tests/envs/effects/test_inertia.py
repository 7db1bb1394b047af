import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import EffectError
from envs.plant import Plant

MOTOR = '<motor name="servo" joint="hinge"/>'
ARM = """<mujoco><option timestep="0.001"/><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0.05" mass="0.3"/>
    <body name="lower" pos="0.2 0 0.05"><joint name="elbow" axis="0 1 0"/>
      <geom type="box" size="0.1 0.02 0.01" pos="0.1 0 0" euler="0 20 10" mass="0.2"/>
    </body></body></worldbody></mujoco>"""


def swing(spec: mujoco.MjSpec, steps: int = 400) -> np.ndarray:
    """Let a model of two hinges swing from rest in plain MuJoCo; return its angles."""
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [0.3, -0.5]
    mujoco.mj_step(model, data, steps)
    return data.qpos


def plant_swing(effects: list, values: list, steps: int = 400) -> np.ndarray:
    """The same in a plant under effects."""
    plant = Plant(mujoco.MjSpec.from_string(ARM), effects, 1, 1)
    plant.set_params(np.arange(1), np.array([values]))
    start = np.array([[0.3, -0.5]])
    plant.reset(np.arange(1), start, np.zeros((1, 2)), np.zeros(1, np.uint64))
    plant.step(None, np.zeros((1, 0)), steps)
    return plant.qpos[0]


@pytest.mark.parametrize("body", ["upper", "lower"])
def test_mass_and_center_follow_a_model_that_was_written_so(body: str) -> None:
    """Values in the plant and in the MJCF give the same swing, derived constants included."""
    nominal = mujoco.MjSpec.from_string(ARM).compile()
    spec = mujoco.MjSpec.from_string(ARM)
    written, compiled = spec.body(body), nominal.body(body)
    for geom in written.geoms:
        geom.mass = 0.0
    direction = {"upper": [0.2, 0.0, 0.05]}.get(body)
    end = direction or far_tip(nominal, body)
    written.explicitinertial = True
    written.mass = compiled.mass[0] + 0.07
    written.ipos = compiled.ipos + 0.02 * np.array(end) / np.linalg.norm(end)
    written.iquat, written.inertia = compiled.iquat, compiled.inertia
    effects = [make("link_mass", where=body), make("center_of_mass", where=body)]
    assert plant_swing(effects, [0.07, 0.02]) == pytest.approx(swing(spec), abs=1e-9)


def far_tip(model: mujoco.MjModel, body: str) -> np.ndarray:
    """Return the end of the lower box's long axis that is farthest from its joint."""
    geom = int(model.body(body).geomadr[0])
    axis = np.zeros(9)
    mujoco.mju_quat2Mat(axis, model.geom_quat[geom])
    along = 0.1 * axis.reshape(3, 3)[:, 0]
    return max(model.geom_pos[geom] + along, model.geom_pos[geom] - along, key=np.linalg.norm)


@pytest.mark.parametrize("body", ["upper", "lower"])
def test_payload_is_a_point_at_the_far_end(body: str) -> None:
    """A tiny heavy sphere in the MJCF at that point swings the same."""
    nominal = mujoco.MjSpec.from_string(ARM).compile()
    spec = mujoco.MjSpec.from_string(ARM)
    end = np.array([0.2, 0.0, 0.05]) if body == "upper" else far_tip(nominal, body)
    sphere = mujoco.mjtGeom.mjGEOM_SPHERE
    ball = {"type": sphere, "size": [1e-4, 0, 0], "mass": 0.15, "contype": 0, "conaffinity": 0}
    spec.body(body).add_geom(pos=end, **ball)
    found = plant_swing([make("payload", where=body)], [0.15])
    assert found == pytest.approx(swing(spec), abs=1e-6)


def test_payload_sets_the_period_of_a_pendulum(bench, one) -> None:
    """Small swings of the loaded link have T = 2 pi sqrt(I / m g l)."""
    payload, g = 0.3, 9.81
    arm = bench([one("payload")], [[payload]], MOTOR, gravity=g, armature=0.0)
    arm.reset(np.pi / 2 + 0.05)
    angles = arm.run(np.zeros(4000))[0][:, 0] - np.pi / 2
    crossings = np.flatnonzero(np.diff(np.sign(angles)))
    period = 2 * np.diff(crossings).mean() * 1e-3
    inertia = 1e-4 + 0.2 * 0.1**2 + payload * 0.2**2
    torque = g * (0.2 * 0.1 + payload * 0.2)
    assert period == pytest.approx(2 * np.pi * np.sqrt(inertia / torque), rel=2e-3)


def test_payload_sags_a_servo(bench, one) -> None:
    """The level link hangs lower by the payload's torque over the gain."""
    arm = bench([one("payload")], [[0.0], [0.1]], gravity=9.81)
    arm.reset()
    end = arm.hold(0.0, 6.0)
    torque = 9.81 * np.cos(end) * (0.2 * 0.1 + np.array([0.0, 0.1]) * 0.2)
    assert 4 * end == pytest.approx(torque, rel=1e-5)


def test_gravity_tilt_turns_the_equilibrium(bench, one) -> None:
    """A free pendulum rests where down is: tilted about y by the second value."""
    tilts = np.array([[0.0, 0.0], [0.0, 0.2], [0.0, -0.1], [0.3, 0.0]])
    arm = bench([make("gravity_tilt")], tilts, MOTOR, gravity=9.81, damping=0.05)
    arm.reset(np.pi / 2 - 0.1)
    rest = arm.hold(0.0, 4.0) - np.pi / 2
    assert rest == pytest.approx([0.0, -0.2, 0.1, 0.0], abs=1e-6)


def test_gravity_keeps_its_size_and_turns_x_before_y() -> None:
    """Base turned by a about x, then by b about its new y: gravity is R^T g."""
    a, b = 0.3, -0.4
    plant = Plant(mujoco.MjSpec.from_string(ARM), [make("gravity_tilt")], 1, 1)
    plant.set_params(np.arange(1), np.array([[a, b]]))
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    expected = (rx @ ry).T @ np.array([0, 0, -9.81])
    assert plant.field("opt.gravity")[0] == pytest.approx(expected, abs=1e-12)


def test_a_negative_mass_is_refused(bench, one) -> None:
    """Taking off more than the body weighs is an error that names value and range."""
    with pytest.raises(ValueError, match=r"link_mass.link = -0.3 kg .* outside \[-0.199"):
        bench([one("link_mass")], [[-0.3]])


def test_a_body_without_a_far_end_is_refused() -> None:
    """There is no direction to move the centre of mass in."""
    text = '<mujoco><worldbody><body name="ball"><freejoint/><geom size="0.1"/></body>'
    text += "</worldbody></mujoco>"
    spec = mujoco.MjSpec.from_string(text)
    with pytest.raises(EffectError, match="'ball' has no child, site or geom"):
        Plant(spec, [make("center_of_mass", where="ball")], 1, 1)


ROD = """<mujoco><option timestep="0.0005"/><worldbody><body name="rod">
    <joint name="hinge" axis="0 1 0"/><geom type="capsule" size="0.01" mass="0.3"
    fromto="0 0 0 0 0 -0.3"/></body></worldbody></mujoco>"""


def test_link_inertia_sets_the_period_of_a_pendulum() -> None:
    """J = f J_cm + m r² about the joint; what gravity pulls stays: T = 2 pi sqrt(J / m g r)."""
    spec = mujoco.MjSpec.from_string(ROD)
    model = spec.copy().compile()
    factors = [0.25, 1.0, 4.0]
    plant = Plant(spec, [make("link_inertia", where="rod")], 3, 1)
    plant.set_params(np.arange(3), np.array(factors)[:, None])
    plant.reset(np.arange(3), np.full((3, 1), 0.05), np.zeros((3, 1)), np.zeros(3, np.uint64))
    angles = []
    for _ in range(4000):
        plant.step(None, np.zeros((3, 0)), 1)
        angles.append(plant.qpos[:, 0].copy())
    own, arm, mass = model.body_inertia[1].max(), 0.15, float(model.body_mass[1])
    for k, factor in enumerate(factors):
        path = np.array(angles)[:, k]
        crossing = np.flatnonzero((path[:-1] > 0) & (path[1:] <= 0))[0] * model.opt.timestep
        period = 2 * np.pi * np.sqrt((factor * own + mass * arm**2) / (mass * 9.81 * arm))
        assert crossing == pytest.approx(period / 4, rel=5e-3)


def test_two_rigid_values_act_like_a_motor_of_another_strength() -> None:
    """Twice as heavy and twice as hard to turn, a rod swings as with half the motor."""
    motor = '<actuator><motor name="servo" joint="hinge" gear="0.3"/></actuator></mujoco>'
    text = ROD.replace('axis="0 1 0"', 'axis="0 1 0" armature="0.002"')
    spec = mujoco.MjSpec.from_string(text.replace("</mujoco>", motor))
    model = spec.copy().compile()
    own = float(model.dof_armature[0] + model.body_inertia[1].max())  # beside m r²
    effects = [
        make("armature", where="hinge"),
        make("link_mass", where="rod", how="scale"),
        make("motor_strength", where="servo"),
    ]
    plant = Plant(spec, effects, 3, 1)
    plant.set_params(np.arange(3), np.array([[own, 2.0, 1.0], [0.0, 1.0, 0.5], [0.0, 1.0, 1.0]]))
    plant.reset(np.arange(3), np.zeros((3, 1)), np.zeros((3, 1)), np.zeros(3, np.uint64))
    path = []
    for step in range(4000):
        plant.step(None, np.full((3, 1), np.sin(0.004 * step + 1e-6 * step**2)), 1)
        path.append(plant.qpos[:, 0].copy())
    heavy, weak, plain = np.array(path).T
    assert heavy == pytest.approx(weak, abs=1e-6)
    assert np.abs(heavy - plain).max() > 0.1
