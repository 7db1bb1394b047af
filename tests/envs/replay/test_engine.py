"""Replays against motions whose course is known in closed form."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import TaskError
from envs.plant import Plant
from envs.replay import DivergedError, Recording, replay, schedule, simulate, switchable

SERVO = """
<mujoco><option timestep="0.001" gravity="0 0 0"/>
<worldbody>
<body><joint name="a" damping="{damping}"/><geom size=".05" mass="{mass}"/></body>
</worldbody>
<actuator><{actuator} name="a" joint="a" {gain}/></actuator></mujoco>
"""


def motor(mass: float = 1.0) -> mujoco.MjSpec:
    """Return one joint driven by a torque."""
    xml = SERVO.format(damping=0, mass=mass, actuator="motor", gain="")
    return mujoco.MjSpec.from_string(xml)


def push(times: list[float], torques: list[float], **more: np.ndarray) -> Recording:
    """Return a recording of torques that starts at rest."""
    ctrl = np.array(torques)[:, None]
    return Recording(np.array(times), ctrl, np.zeros(1), np.zeros(1), **more)


def inertia(spec: mujoco.MjSpec) -> float:
    """Return the inertia of the joint's body about it [kg m²]."""
    model = spec.copy().compile()
    return float(model.dof_M0[0])


def test_a_constant_torque_gives_a_parabola_at_irregular_times() -> None:
    """Under torque u the angle is u t² / (2 I), whenever it is asked for."""
    spec, times = motor(), [0.0, 0.0134, 0.05, 0.0777, 0.2]
    (path,) = replay(Plant(spec), [push(times, [0.001] * 5)])
    expected = 0.001 * np.square(times) / (2 * inertia(spec))
    np.testing.assert_allclose(path[:, 0], expected, atol=0.02 * expected[-1])


def test_a_command_acts_at_the_first_step_not_before_its_time() -> None:
    """A torque written at 10.4 ms starts to act in the step at 11 ms, one at 10 ms in that one."""
    spec = motor()
    rows = [push([0.0, start, 0.03], [0.0, 1.0, 1.0]) for start in (0.0104, 0.011, 0.010)]
    late, same, earlier = (p[-1, 0] for p in replay(Plant(spec, num_rows=3), rows))
    assert late == same < earlier


def test_a_servo_that_is_off_exerts_nothing() -> None:
    """While its torque is off the joint coasts; others in the batch keep their torque."""
    spec = switchable(motor())
    on = np.array([[True], [False], [False], [True]])
    times, torques = [0.0, 0.05, 0.1, 0.15], [1.0] * 4
    rows = [push(times, torques, powered=on), push(times, torques)]
    off, free = replay(Plant(spec, num_rows=2), rows)
    speed = np.diff(off[:, 0]) / 0.05
    assert speed[1] == pytest.approx(speed[2], rel=1e-6)
    assert free[-1, 0] > 1.5 * off[-1, 0]


def test_a_servo_that_is_off_does_not_brake() -> None:
    """Back-EMF, the actuator's damping, ends with its torque and is back when that is on again."""
    xml = SERVO.format(damping=0, mass=1.0, actuator="motor", gain='damping="0.1"')
    spec, time = switchable(mujoco.MjSpec.from_string(xml)), np.arange(150) * 0.001
    on = (time < 0.05) | (time >= 0.1)
    coasting = Recording(time, np.zeros((150, 1)), np.zeros(1), np.ones(1), on[:, None])
    (path,) = replay(Plant(spec), [coasting])
    speed = np.diff(path[:, 0])
    assert speed[60] == pytest.approx(speed[95], rel=1e-9)
    assert speed[40] < speed[10]
    assert speed[140] < speed[105]


def test_candidates_run_side_by_side() -> None:
    """The same recording under four armatures bends by the ratio of the inertias."""
    spec = motor()
    plant = Plant(spec, [make("armature", where="a")], num_rows=4)
    own, added = inertia(spec), np.arange(4) * 0.01
    plant.set_params(np.arange(4), added[:, None])
    paths = replay(plant, [push([0.0, 0.1], [0.01, 0.01])] * 4)
    turned = np.array([path[-1, 0] for path in paths])
    np.testing.assert_allclose(turned / turned[0], own / (own + added), rtol=1e-6)


def test_a_model_that_cannot_follow_is_named_with_the_moment() -> None:
    """A gain far beyond what the time step carries diverges; which row and when is said."""
    gain = 'kp="1e9"'
    wild = SERVO.format(damping=0, mass=0.001, actuator="position", gain=gain)
    plant = Plant(mujoco.MjSpec.from_string(wild), num_rows=2)
    rows = [push([0.0, 0.5], [0.0, 0.0]), push([0.0, 0.5], [1.0, 1.0])]
    with pytest.raises(DivergedError, match="recording 1 diverges at") as caught:
        replay(plant, rows)
    assert caught.value.row == 1
    assert 0 < caught.value.time < 0.5


def test_rows_and_recordings_must_agree() -> None:
    """A plant of one row does not take two recordings."""
    with pytest.raises(TaskError, match="2 recordings for a plant of 1 rows"):
        replay(Plant(motor()), [push([0.0, 0.1], [0.0, 0.0])] * 2)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (("command_delay", {}, 0.013),),
        (("observation_delay", {}, 0.017), ("encoder_offset", {"where": "a"}, 0.02)),
        (("thermal_derating", {"where": "a"}, 0.5), ("backlash", {"where": "a"}, 0.01)),
    ],
    ids=lambda effects: "-".join(effect[0] for effect in effects),
)
def test_a_row_does_not_notice_its_neighbours(effects: tuple[tuple[str, dict, float], ...]) -> None:
    """Alone, or beside longer rows and rows whose servo is switched off: the same to the bit."""
    xml = SERVO.format(damping=0.1, mass=1.0, actuator="position", gain='kp="5" damping="0.1"')
    spec, rng = switchable(mujoco.MjSpec.from_string(xml)), np.random.default_rng(0)
    rows = []
    for count in (30, 40, 25):
        time = np.cumsum(rng.uniform(0.004, 0.02, count)) - 0.004
        ctrl, on = rng.uniform(-1, 1, (count, 1)), rng.uniform(size=(count, 1)) < 0.8
        start = Recording(time - time[0], ctrl, rng.uniform(-1, 1, 1), rng.uniform(-1, 1, 1))
        rows.append(start._replace(powered=on if count != 30 else None, held=ctrl[3]))
    fixed = [(make(name, **where), (value,)) for name, where, value in effects]
    alone = [replay(Plant(spec, fixed=fixed), [row])[0] for row in rows]
    beside = replay(Plant(spec, num_rows=3, fixed=fixed), rows)
    for one, other in zip(alone, beside, strict=True):
        assert np.array_equal(one, other)
    assert np.ptp(alone[0]) > 0.1


@pytest.mark.parametrize("offset", [0.0, 0.2])
def test_commands_on_their_way_at_the_start_arrive(offset: float) -> None:
    """From the middle of a recording a replay goes on as from its beginning, however late."""
    xml = SERVO.format(damping=0.1, mass=1.0, actuator="position", gain='kp="5" damping="0.1"')
    spec, rng = mujoco.MjSpec.from_string(xml), np.random.default_rng(0)
    effects = (("command_delay", {}, 0.037), ("encoder_offset", {"where": "a"}, offset))
    fixed = [(make(name, **where), (value,)) for name, where, value in effects]
    time, ctrl = 0.01 * np.arange(60), rng.uniform(-1, 1, (60, 1))
    whole = Recording(time, ctrl, np.full(1, 0.3), np.zeros(1), held=ctrl[0])
    plant, dt, row = Plant(spec, fixed=fixed), 0.001, 30
    path = simulate(plant, [schedule(whole, dt)]).qpos[0]
    step = round(time[row] / dt)
    start = Recording(
        time[row:] - time[row],
        ctrl[row:],
        path[step],
        (path[step] - path[step - 1]) / dt,
        held=ctrl[row - 1],
        since=time[:row] - time[row],
        past=ctrl[:row],
    )
    (later,) = replay(plant, [start])
    np.testing.assert_allclose(later, path[step::10][: len(later)], atol=1e-9)
    (none,) = replay(plant, [start._replace(past=None)])
    assert np.abs(none - later).max() > 0.01


def test_steps_are_bounded_by_rows() -> None:
    """A row a thousand million seconds after the first is refused before anything is allocated."""
    recording = Recording(np.array([0.0, 1e9]), np.zeros((2, 1)), np.zeros(1), np.zeros(1))
    with pytest.raises(TaskError, match=r"1e\+09 s in 2 rows are 5e\+11 steps .* more than the"):
        schedule(recording, 0.002)


def test_more_actuators_than_groups_are_off_and_on_together() -> None:
    """Each of forty sliders coasts while its torque is off."""
    body = '<body pos="{0} 0 0"><joint name="j{0}" type="slide"/><geom size="0.1"/></body>'
    text = "".join(body.format(i) for i in range(40))
    drives = "".join(f'<motor joint="j{i}"/>' for i in range(40))
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option gravity="0 0 0"/><worldbody>{text}</worldbody>'
        f"<actuator>{drives}</actuator></mujoco>"
    )
    on = np.array([[True] * 40, [False] * 40, [False] * 40])
    recording = Recording(np.array([0, 0.1, 0.2]), np.ones((3, 40)), np.zeros(40), np.zeros(40), on)
    (path,) = replay(Plant(switchable(spec), num_rows=1), [recording])
    gone = np.diff(path, axis=0)
    assert np.ptp(gone, axis=1) == pytest.approx(0.0, abs=1e-12)
    assert gone[1, 0] == pytest.approx(2 * gone[0, 0], rel=0.03)  # at the speed that it had


def test_what_was_read_before_a_start_is_compared_with_the_motion_before_it() -> None:
    """A joint that coasts at 2 rad/s was 6 mrad behind its start 3 ms before it."""
    plant, steps = Plant(motor(), [], 1), 0.02 * np.arange(5)
    none = np.zeros((5, 1))
    recording = Recording(steps, none, np.zeros(1), np.array([2.0]), read=steps[:, None] - 0.003)
    motion = simulate(plant, [schedule(recording, 0.001)])
    read = motion.at_rows(0, recording)
    np.testing.assert_allclose(read[:, 0], 2.0 * (steps - 0.003), atol=1e-9)
