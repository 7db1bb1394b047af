"""MuJoCo Warp on its CPU device against the batch: effects, tasks, starts, failures, training."""

import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
import torch
from torchrl.envs.utils import check_env_specs

from envs import tasks
from envs.effects import EFFECTS, Goal, make
from envs.effects.base import Effect
from envs.errors import TaskError
from envs.mujoco import MujocoEnv
from envs.noise import normal, uniform
from envs.physics.arrays import Arrays
from envs.randomization import Draw, Randomization
from envs.simulation import Simulation
from envs.tasks.base import State, Task
from envs.tasks.servo.base import Fidelity
from envs.tasks.servo.bench1 import Bench1
from envs.tasks.servo.hopper2 import Hopper2
from envs.tasks.servo.quad8 import Quad8
from envs.tasks.servo.quad12 import Quad12

if find_spec("mujoco_warp") is None and "SIM2REAL_GPU_EXTRA" not in os.environ:
    pytest.skip("needs MuJoCo Warp: pip install 'sim2real[gpu]'", allow_module_level=True)

ROWS = 3
PARITY = 2e-5  # rad, m: float32 against float64 over ten control steps without a change of contact


def pair(
    make_task: Callable[[], Task], effects: Callable[[], list[Effect]]
) -> tuple[Simulation, Simulation]:
    """The same rows on both engines."""
    batch = Simulation(make_task(), ROWS, effects(), threads=1)
    return batch, Simulation(make_task(), ROWS, effects(), threads=1, physics="warp")


def gap(batch: Simulation, warp: Simulation, values: np.ndarray, steps: int = 10) -> float:
    """Play the same actions on both; return the largest gap in what they show."""
    ids = np.arange(ROWS)
    seeds = ids.astype(np.uint64)
    seen, other = batch.reset(ids, values, seeds), warp.reset(ids, values, seeds)
    gaps, rng = [np.abs(seen - other.cpu().numpy()).max()], np.random.default_rng(0)
    low, high = np.maximum(batch.action_low, -0.3), np.minimum(batch.action_high, 0.3)
    for _ in range(steps):
        action = rng.uniform(low, high, (ROWS, batch.action_size))
        step, found = batch.step(None, action), warp.step(None, torch.from_numpy(action).float())
        assert step.terminated.tolist() == found.terminated.tolist()
        assert step.truncated.tolist() == found.truncated.tolist()
        positions = warp.plant.qpos.cpu().numpy()
        gaps.append(np.abs(batch.plant.qpos - positions).max())
        gaps.append(np.abs(step.reward - found.reward.cpu().numpy()).max())
    return float(max(gaps))


def test_a_hopper_with_parameters_is_the_same_on_both_engines() -> None:
    """Masses and frictions of each row, derived constants included, in float32."""
    batch, warp = pair(
        tasks.Hopper, lambda: [make("link_mass", where="torso"), make("ground_friction")]
    )
    values = np.array([[0.0, 1.0], [1.0, 1.2], [3.0, 0.8]])
    assert gap(batch, warp, values) < PARITY
    # rows that are not stepped stay, to the bit; new parameters are those of the next episode
    before = warp.plant.qpos.clone()
    warp.step(np.array([1]), torch.zeros(1, 3))
    moved = (warp.plant.qpos != before).any(1)
    assert moved.tolist() == [False, True, False]
    assert gap(batch, warp, values[::-1]) < PARITY


ONE = {  # where an effect acts on quad8, and three values of its parameters
    "actuator_lag": ("hip_fl", [0.0, 0.005, 0.02]),
    "armature": ("hip_fl", [0.0, 1e-3, 3e-3]),
    "asymmetric_friction": ("hip_fl", [0.0, 0.02, -0.05]),
    "backlash": ("hip_fl", [0.01, 0.02, 0.03]),
    "center_of_mass": ("thigh_fl", [0.0, 0.01, -0.01]),
    "clock_drift": (None, [0.0, 0.02, -0.02]),
    "cogging": ("hip_fl", [0.0, 0.02, 0.05]),
    "command_delay": (None, [0.0, 0.004, 0.015]),
    "contact_stiffness": (None, [1.0, 0.5, 2.0]),
    "coulomb_friction": ("hip_fl", [0.0, 0.02, 0.05]),
    "dead_zone": ("hip_fl", [0.0, 0.01, 0.04]),
    "derivative_gain": ("hip_fl", [0.0, 1e-3, 3e-3]),
    "encoder_eccentricity": ("hip_fl", [0.0, 0.02, 0.05]),
    "encoder_offset": ("hip_fl", [0.0, 0.02, -0.05]),
    "gravity_tilt": (None, [[0.0, 0.0], [0.05, -0.05], [-0.1, 0.02]]),
    "ground_friction": (None, [1.0, 0.7, 1.4]),
    "gyro_bias": (None, [[0.0, 0.0, 0.0], [0.1, -0.2, 0.05], [0.0, 0.0, 0.3]]),
    "gyro_scale": (None, [1.0, 1.3, 0.8]),
    "hysteretic_compliance": ("hip_fl", [0.05, 0.1, 0.2]),
    "imu_delay": (None, [0.0, 0.004, 0.015]),
    "imu_mounting": (None, [[0.0, 0.0, 0.0], [0.06, -0.03, 0.02], [0.0, 0.1, 0.0]]),
    "integral_action": ("hip_fl", [0.0, 2.0, 10.0]),
    "joint_compliance": ("hip_fl", [0.05, 0.1, 0.2]),
    "link_inertia": ("thigh_fl", [1.0, 0.7, 1.5]),
    "link_length": ("thigh_fl", [1.0, 1.05, 0.95]),
    "link_mass": ("thigh_fl", [0.0, 0.02, 0.05]),
    "load_dependent_friction": ("hip_fl", [0.0, 0.1, 0.3]),
    "motor_strength": (None, [1.0, 0.8, 1.1]),
    "observation_delay": (None, [0.0, 0.004, 0.015]),
    "packet_loss": (None, [0.0, 0.3, 0.6]),
    "payload": ("shank_fl", [0.0, 0.02, 0.05]),
    "position_gain": ("hip_fl", [1.0, 0.8, 1.2]),
    "profile_acceleration": ("hip_fl", [10.0, 100.0, 1e6]),
    "profile_velocity": ("hip_fl", [1.0, 5.0, 1e6]),
    "quantization": (None, [0.0, 0.002, 0.01]),
    "restitution": (None, [0.1, 0.3, 0.6]),
    "sensor_noise": (None, [0.0, 0.002, 0.01]),
    "stribeck_friction": ("hip_fl", [0.0, 0.02, 0.05]),
    "supply_sag": (None, [0.0, 0.5, 1.5]),
    "supply_voltage": (None, [0.0, 0.2, 0.5]),
    "surface_friction": (None, [1.0, 0.7, 1.4]),
    "thermal_derating": ("hip_fl", [0.0, 1.0, 5.0]),
    "torque_limit": ("hip_fl", [1.0, 0.8, 0.6]),
    "torque_speed_knee": ("hip_fl", [1.0, 3.0, 1e6]),
    "velocity_filter": (None, [0.0, 0.004, 0.02]),
    "viscous_friction": ("hip_fl", [0.0, 1e-3, 5e-3]),
}
NEEDED = {"supply_sag": {"voltage": 7.4, "torque_constant": 0.6}}
UNSEEN = {"camera_shift", "camera_turn", "colour", "goal", "light_direction", "light_level"}


@pytest.mark.slow
def test_every_effect_that_is_offered_is_compared() -> None:
    """What the engine has is what the parity below goes through."""
    offered = {name for name, effect in EFFECTS.items() if "warp" in effect.engines}
    assert offered == ONE.keys() | UNSEEN


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE)
def test_effects_are_the_same_on_both_engines(name: str) -> None:
    """Three values of the effect in three rows of a robot that stands on its feet."""
    where, values = ONE[name]
    given: dict[str, Any] = NEEDED.get(name, {})
    batch, warp = pair(lambda: Quad8("ideal"), lambda: [make(name, where=where, **given)])
    assert gap(batch, warp, np.array(values, float).reshape(ROWS, -1)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "given", "values"),
    [
        ("backlash", {"side": "link"}, [0.0, 0.02, 0.03]),
        ("joint_compliance", {"side": "link"}, [0.0, 0.1, 0.2]),
        ("dead_zone", {"punch": 0.0}, [0.0, 0.01, 0.04]),
        ("stribeck_friction", {"bristle": 0.01}, [0.0, 0.02, 0.05]),
        ("load_dependent_friction", {"external": 0.0}, [0.0, 0.1, 0.3]),
        ("thermal_derating", {"braking": 1.0, "decay": 0.5}, [0.0, 1.0, 5.0]),
    ],
)
def test_the_ways_of_an_effect_are_the_same_on_both_engines(name: str, given, values) -> None:
    """Loops that are closed behind a joint, bristles, loads and heat."""
    batch, warp = pair(lambda: Quad8("ideal"), lambda: [make(name, where="hip_fl", **given)])
    assert gap(batch, warp, np.array(values).reshape(ROWS, 1)) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("fidelity", ["ideal", "servo"])  # lines that interpolate, and that hold
def test_laws_read_late_commands_on_both_engines(fidelity: Fidelity) -> None:
    """What a law before a substep reads of a delay line is what the engine acts on."""
    late = [make("command_delay")] if fidelity == "ideal" else []
    rules = [make("dead_zone", where="hip_fl"), make("integral_action", where="knee_fl")]
    rules += [make("actuator_lag", where="hip_fr")]
    batch, warp = pair(lambda: Quad8(fidelity), lambda: [*rules, *late])
    values = np.array([[0.0, 0.0, 0.0], [0.01, 2.0, 0.005], [0.03, 10.0, 0.02]])
    delays = np.array([[0.0], [0.0035], [0.02]])[:, : len(late)]
    assert gap(batch, warp, np.hstack([values, delays])) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gyro_bias", "gyro_scale", "imu_delay", "imu_mounting"])
def test_an_imu_says_the_same_on_both_engines(name: str) -> None:
    """Orientation and angular velocity of the base, which no position or reward shows."""
    where, values = ONE[name]
    batch, warp = pair(lambda: Quad8("ideal"), lambda: [make(name, where=where)])
    gap(batch, warp, np.array(values, float).reshape(ROWS, -1), steps=5)
    (said, spin), (other, turning) = batch.plant.measured(None), warp.plant.measured(None)
    base, gyro = slice(3, 7), slice(3, 6)
    true = batch.plant.qpos[1:, base], batch.plant.qvel[1:, gyro]
    moved = np.abs(said[1:, base] - true[0]).max(), np.abs(spin[1:, gyro] - true[1]).max()
    assert max(moved) > 1e-2  # the effect is there
    assert np.abs(said[:, base] - other[:, base].cpu().numpy()).max() < 1e-4
    assert np.abs(spin[:, gyro] - turning[:, gyro].cpu().numpy()).max() < 1e-2  # rad/s


@pytest.mark.slow
def test_rules_rest_in_rows_that_are_not_stepped() -> None:
    """Heat, and the rows whose parameters change, are each row's own."""
    batch, warp = pair(
        lambda: Quad8("ideal"), lambda: [make("thermal_derating"), make("stribeck_friction")]
    )
    ids, seeds = np.arange(ROWS), np.arange(ROWS, dtype=np.uint64)
    values = np.array([[0.0, 0.0], [3.0, 0.02], [1.0, 0.05]])
    action = np.full((ROWS, batch.action_size), 0.2)
    for one, act in ((batch, action), (warp, torch.from_numpy(action).float())):
        one.reset(ids, values, seeds)
        one.step(None, act)
        one.step(ids[1:], act[1:])
        one.reset(ids[:1], values[2:], seeds[:1])
        for _ in range(4):
            one.step(None, act)
    assert np.abs(batch.plant.qpos - warp.plant.qpos.cpu().numpy()).max() < 1e-3


BEFORE = {"Ant": 2, "EasiAnt": 1}  # control steps before a contact falls on the other side of one
TASKS: dict[str, Callable[[], Task]] = {
    **{
        name: getattr(tasks, name)
        for name in (
            "Ant",
            "BallBalance",
            "EasiAnt",
            "HalfCheetah",
            "HopperPolito",
            "InvertedPendulum",
            "Swimmer",
            "Walker2d",
        )
    },
    "Quad8": Quad8,
    "Quad12": Quad12,
    "Hopper2": Hopper2,
    "Bench1": Bench1,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_tasks_are_the_same_on_both_engines(name: str) -> None:
    """Starts, positions and rewards, from one text."""
    batch, warp = pair(TASKS[name], list)
    rounded = 5e-3 if name == "EasiAnt" else 1e-3  # it runs to 1 km, in float32 known to 60 um
    assert gap(batch, warp, np.zeros((ROWS, 0)), steps=BEFORE.get(name, 5)) < rounded


@pytest.mark.slow
def test_goals_reach_the_reward() -> None:
    """A goal is a parameter of each row on a device, too."""
    batch, warp = pair(tasks.HalfCheetahDirection, lambda: [Goal()])
    assert gap(batch, warp, np.array([[1.0], [-1.0], [1.0]]), steps=3) < 1e-3


@pytest.mark.slow
def test_the_environment_keeps_torchrls_contract() -> None:
    """Specs, parameters in the tensordict, partial resets, and episodes that go on."""
    draws = Randomization([Draw(make("link_mass", where="torso"), low=0.0, high=2.0)])
    env = MujocoEnv(tasks.Hopper(), 4, draws.effects, tasks=draws, physics="warp", seed=3)
    check_env_specs(env)
    same = MujocoEnv(tasks.Hopper(), 4, draws.effects, tasks=draws, seed=3)
    for one in (env, same):
        one.set_seed(5)
    drawn, known = env.reset(), same.reset()
    name = ("params", "link_mass.torso")
    assert torch.equal(drawn[name], known[name])  # the draws are the host's
    assert torch.allclose(drawn["observation"], known["observation"], atol=1e-6)
    rollout = env.rollout(60, break_when_any_done=False)
    assert rollout["next", "done"].any()
    state, seen = env.episodes(), env._last.clone()
    env.resume(state)
    assert torch.equal(env._last, seen)  # to the bit on the CPU device


@pytest.mark.slow
def test_broken_rows_fail_and_start_again() -> None:
    """A state that is not finite, or an action, ends its own row; a reset makes it whole."""
    warp = Simulation(tasks.Hopper(), ROWS, threads=1, physics="warp")
    ids = np.arange(ROWS)
    warp.reset(ids, np.zeros((ROWS, 0)), ids.astype(np.uint64))
    warp.plant.layout.raw_qvel[1] = float("nan")
    action = torch.zeros(ROWS, 3)
    action[2, 0] = float("nan")
    step = warp.step(None, action)
    assert step.failed.tolist() == [False, True, True]
    assert step.terminated.tolist()[1:] == [True, True]
    assert torch.equal(step.observation[1:], torch.zeros(2, 11))
    assert step.reward[1:].tolist() == [0.0, 0.0]
    warp.reset(ids[1:], np.zeros((2, 0)), ids[1:].astype(np.uint64))
    step = warp.step(None, torch.zeros(ROWS, 3))
    assert not step.failed.any()


class _Numpy(tasks.Hopper):
    """A user's task that calls NumPy."""

    array_api = False

    def observe(self, state: State) -> np.ndarray:
        return np.concatenate([state.qpos, state.qvel], axis=1)


def test_what_the_engine_lacks_is_refused_by_name() -> None:
    """Tasks for NumPy alone, contact forces, devices that are not there."""
    with pytest.raises(TaskError, match="_Numpy computes with NumPy only"):
        Simulation(_Numpy(), 1, threads=1, physics="warp")
    with pytest.raises(TaskError, match="contact forces"):
        Simulation(tasks.Ant("exact"), 1, threads=1, physics="warp")
    with pytest.raises(TaskError, match="device=meta is not there"):
        Simulation(tasks.Hopper(), 1, threads=1, physics="warp", device="meta")


def test_random_numbers_are_the_hosts_bits() -> None:
    """Torch's signed integers give the draws of NumPy's unsigned ones."""
    import array_api_compat.torch as xp

    seeds = np.array([0, 1, 2**63 + 5, 2**64 - 1], np.uint64)
    streams = np.array([3, 2**33, 0, 7])
    arrays = Arrays(xp, torch.float32, torch.device("cpu"))
    own = arrays.own(seeds), arrays.own(streams)
    assert np.array_equal(uniform(*own, 5, xp).numpy(), uniform(seeds, streams, 5))
    assert np.allclose(normal(*own, 5, xp).numpy(), normal(seeds, streams, 5), atol=1e-12)


@pytest.mark.gpu
def test_a_graph_on_the_card_is_the_batch() -> None:
    """The same rows on a CUDA device, where a control step is one graph."""
    batch = Simulation(tasks.Hopper(), ROWS, threads=1)
    warp = Simulation(tasks.Hopper(), ROWS, threads=1, physics="warp", device="cuda")
    ids = np.arange(ROWS)
    for one in (batch, warp):
        one.reset(ids, np.zeros((ROWS, 0)), ids.astype(np.uint64))
    for _ in range(10):
        batch.step(None, np.zeros((ROWS, 3)))
        warp.step(None, torch.zeros(ROWS, 3, device="cuda"))
    assert np.abs(batch.plant.qpos - warp.plant.qpos.cpu().numpy()).max() < PARITY
