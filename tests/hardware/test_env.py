"""A robot as an environment: the specs and numbers of its twin, and nothing moves unasked."""

import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torchrl.collectors import Collector
from torchrl.envs.utils import check_env_specs

from envs.mujoco import MujocoEnv
from envs.simulation import Simulation
from envs.tasks import Bench1, Hopper2, Quad8, Quad12
from envs.tasks.servo.drive import COUNT
from hardware.backends import ServoBackend
from hardware.clock import VirtualClock
from hardware.config import load_robot
from hardware.emulator.faults import Fault
from hardware.emulator.firmware import TICK, Firmware
from hardware.emulator.pty import serve
from hardware.emulator.world import EmulatedRobot
from hardware.env import HardwareEnv
from hardware.errors import RobotError, SafetyError, SerialPortError
from hardware.log import read_log, read_logs
from hardware.rows import RobotRows
from hardware.safety import StopLimits
from tests.hardware.rig import in_real_time

ROW, NO_VALUES = np.arange(1), np.zeros((1, 0))
SEED = np.array([3], np.uint64)
LEG = pytest.param(Hopper2, "hopper2", marks=pytest.mark.slow)
TWELVE = pytest.param(Quad12, "quad12", marks=pytest.mark.slow)


def loopback(name: str = "bench1", *faults: Fault, settle: float = 0.3, **changes) -> ServoBackend:
    """Return an emulated robot with faults, ready to be opened."""
    robot = load_robot(name)
    return ServoBackend(robot, settle=settle, world=EmulatedRobot(robot, faults=faults), **changes)


def play(rows: RobotRows, actions: np.ndarray) -> np.ndarray:
    """Run an episode of actions (T, A) and return its observations, (T + 1, O)."""
    seen = [rows.reset(ROW, NO_VALUES, SEED)[0]]
    for action in actions:
        step = rows.step(None, action[None])
        seen.append(step.observation[0])
        if step.terminated[0] or step.truncated[0]:
            break
    return np.array(seen)


def powered(backend: ServoBackend) -> list[bool]:
    """Return which emulated servos have torque."""
    assert backend.world is not None
    return backend.world.firmware.torque_on.tolist()


@pytest.mark.parametrize(("task", "name"), [(Bench1, "bench1"), (Quad8, "quad8")])
def test_it_has_the_specs_of_its_twin(task, name):
    """Whatever was made for the simulation fits the robot; only what it says of itself is more."""
    twin, env = MujocoEnv(task(), num_envs=1), HardwareEnv(task(), loopback(name))
    assert env.action_spec == twin.action_spec
    assert env.reward_spec == twin.reward_spec
    assert env.full_done_spec == twin.full_done_spec
    for key in twin.observation_spec.keys():  # noqa: SIM118 - a spec is no dict
        assert env.observation_spec[key] == twin.observation_spec[key]
    assert set(env.observation_spec.keys()) - set(twin.observation_spec.keys()) == {"robot"}


def test_a_constructor_opens_and_moves_nothing():
    """Neither torque nor time nor a byte on the bus before the first reset."""
    backend = loopback()
    env = HardwareEnv(Bench1(), backend)
    assert backend.world is not None
    assert backend.world.time == 0.0
    with pytest.raises(SafetyError, match="not open"):
        _ = backend.guard
    env.close()
    assert powered(backend) == [False]


def test_torchrl_accepts_it_and_its_collector_drives_it():
    """Specs and data agree, and a collector gathers whole episodes over the emulated bus."""
    with HardwareEnv(Bench1(seconds=0.5), loopback()) as env:
        check_env_specs(env)
        collector = Collector(env, None, frames_per_batch=60, total_frames=60)
        batch = next(iter(collector))
        assert batch.numel() == 60
        assert batch["next", "done"].sum() == 2
        assert batch["next", "robot", "fresh"].all()


@pytest.mark.parametrize(("task", "name", "far"), [(Bench1, "bench1", 0.1), (Quad8, "quad8", 0.09)])
def test_observations_are_those_of_the_twin(task, name, far):
    """The same actions give the same observations, up to the bus, the start and the servo's law."""
    simulation, rows = Simulation(task(), 1), RobotRows(task(), loopback(name))
    rng = np.random.default_rng(0)
    steps = rng.uniform(-0.3, 0.3, (5, rows.action_size)).repeat(12, axis=0)
    try:
        here = play(rows, steps)
        there = [simulation.reset(ROW, NO_VALUES, SEED)[0]]
        there += [simulation.step(None, action[None]).observation[0] for action in steps]
    finally:
        rows.close()
    off = np.abs(here - np.array(there))
    angles = [0] if name == "bench1" else list(range(2, 10))
    exact = [2, 3, 4, 5] if name == "bench1" else [10, 11]  # references, clocks, last actions
    assert off[:, angles].max() < far
    np.testing.assert_allclose(here[:, exact], np.array(there)[:, exact], atol=1e-12)


@pytest.mark.parametrize(("task", "name"), [(Hopper2, "hopper2"), (Quad8, "quad8"), TWELVE])
def test_an_episode_starts_where_its_simulation_starts(task, name):
    """Servos that sag do so once: the legs rest within 5 counts of where simulated ones do."""
    rows, made = RobotRows(task(), loopback(name, settle=1.0)), task()
    seen = rows.reset(ROW, NO_VALUES, SEED)[0]
    wanted = Simulation(made, 1, threads=1).reset(ROW, NO_VALUES, SEED)[0]
    model = made.spec().compile()
    sag = np.abs(made.start[made.q] - made.rest(model)).max()
    rows.close()
    angles = slice(0, 2) if name == "hopper2" else slice(2, 2 + len(made.q))
    assert sag > 0.03  # rad: what a second sag would be off by
    np.testing.assert_allclose(seen[angles], wanted[angles], atol=5 * COUNT)


@pytest.mark.parametrize(("task", "name"), [(Bench1, "bench1"), (Quad8, "quad8"), LEG, TWELVE])
def test_readings_are_as_old_as_the_file_says(task, name, monkeypatch):
    """From what a servo measured to the writing of the command: the file's within half a tick.

    How the host's steps lie to the servos' ticks is chance, so that the mean is over several.
    """
    measured, ages = [], []
    present = Firmware.present

    def spy(firmware):
        measured.append((firmware.ticks - 1) * TICK)  # a tick measures, then moves the physics
        return present(firmware)

    monkeypatch.setattr(Firmware, "present", spy)
    robot = load_robot(name)
    for phase in np.arange(4) / 4 * TICK:
        backend = ServoBackend(robot, settle=0.1, clock=VirtualClock(phase))
        rows = RobotRows(task(), backend)
        rows.reset(ROW, NO_VALUES, SEED)
        for _ in range(10):
            last = np.mean(measured[-len(robot.servos) :])
            rows.step(None, np.zeros((1, rows.action_size)))
            ages.append(backend._began + backend.written - last)
        rows.close()
    assert np.mean(ages) == pytest.approx(robot.reading_age, abs=TICK / 2)


def test_what_was_asked_and_what_was_sent_are_both_told():
    """A goal beyond the guard's limits is sent within them, and both are in the tensordict."""
    robot = load_robot("bench1")
    narrow = replace(robot, servos=(replace(robot.servos[0], position=(-0.1, 0.1)),))
    with HardwareEnv(Bench1(), ServoBackend(narrow, settle=0.3)) as env:
        rollout = env.rollout(30, lambda td: td.set("action", torch.full((1, 1), 0.8)))
    assert (rollout["action"] == 0.8).all()
    assert rollout["next", "robot", "goal"].max() > 0.2
    assert rollout["next", "robot", "applied"].max() < 0.11
    assert rollout["next", "robot", "limited"].any()


def test_each_step_is_logged(tmp_path):
    """The log has what was measured, asked for and sent, raw counts and counters, in one file."""
    backend = loopback("bench1", Fault("drop", probability=0.2, start=1.0))
    rows = RobotRows(Bench1(seconds=1.0), backend, tmp_path)
    play(rows, np.full((60, 1), 0.2))
    play(rows, np.full((60, 1), 0.2))
    rows.close()
    first, second = read_log(tmp_path / "episode-0000.csv"), read_log(tmp_path / "episode-0001.csv")
    assert (len(first), set(second.episode)) == (51, {1})
    assert first.column("flag.end").tolist() == [0.0] * 50 + [1.0]
    period = np.diff(first.time[:-1])
    assert period == pytest.approx(0.02, abs=0.02)
    angle = (first.column("sensor.count_hinge") - 2048) * 2 * np.pi / 4096
    np.testing.assert_allclose(angle, first.column("qpos.hinge"), atol=1e-12)
    assert second.column("sensor.lost_hinge")[-1] > 0
    counters = second.meta["counters"]["hinge"]
    assert counters["timeout"] >= second.column("sensor.lost_hinge")[-1] - counters["stale"]
    assert second.meta["missed"] >= 0


def test_a_dry_run_writes_nothing(monkeypatch):
    """Actions are computed from what is measured, and not one write goes out."""
    backend = loopback(dry_run=True)
    assert backend.world is not None
    before = bytes(backend.world.servos[0].memory.data[:104])
    rows = RobotRows(Bench1(seconds=0.4), backend)
    seen = play(rows, np.full((20, 1), 0.5))
    rows.close()
    assert len(seen) == 21
    assert bytes(backend.world.servos[0].memory.data[:104]) == before
    assert np.ptp(seen[:, 0]) < 0.01
    assert rows.note.goal != 0


def test_a_real_robot_is_not_moved_unasked():
    """A port that was not armed is not even opened by a reset."""
    robot = replace(load_robot("bench1"), port="/dev/does-not-exist")
    with (
        HardwareEnv(Bench1(), ServoBackend(robot, settle=0.3)) as env,
        pytest.raises(SafetyError, match=r"bench1 at /dev/does-not-exist is not armed; clear"),
    ):
        check_env_specs(env)


def test_a_stop_ends_the_episode_and_needs_a_hand():
    """A servo that reports an error: failed, off, no further reset until its cause is gone."""
    backend = loopback()
    assert backend.world is not None
    with HardwareEnv(Bench1(), backend) as env:
        env.rollout(5)
        start = env.reset()
        backend.world.firmware.shut_down(0, 0x20)
        rollout = env.rollout(50, auto_reset=False, tensordict=start)
        assert rollout["next", "failed"][0, -1]
        assert rollout["next", "terminated"][0, -1]
        assert powered(backend) == [False]
        assert "overload" in str(env.stopped)
        with pytest.raises(SafetyError, match=r"was stopped: .*overload.*then arm"):
            env.reset()
        backend.guard.driver.bus_client.reboot(1)
        backend.guard.driver.clock.sleep_until(backend.guard.driver.clock.now() + 0.5)
        env.arm()
        assert not env.rollout(5)["next", "failed"].any()


def test_a_cable_that_was_out_is_taken_up_again():
    """Unplugged: the episode fails; plugged in and armed: settings are written anew, it goes on."""
    backend = loopback()
    with HardwareEnv(Bench1(), backend) as env:
        start = env.reset()
        port = backend.guard.driver.bus_client.port
        port.unplugged = True  # type: ignore[attr-defined]
        assert env.rollout(5, auto_reset=False, tensordict=start)["next", "failed"].any()
        with pytest.raises(SerialPortError, match="is the cable in"):
            env.arm()
        with pytest.raises(SafetyError, match=r"was stopped: .*is the cable in"):
            env.reset()
        port.unplugged = False  # type: ignore[attr-defined]
        assert backend.world is not None
        clock = backend.guard.driver.clock
        backend.world.servos[0].reboot(clock.now())
        clock.sleep_until(clock.now() + 0.5)
        env.arm()
        assert backend.world.servos[0].memory["position_p_gain"] == 800
        assert not env.rollout(5)["next", "failed"].any()
    assert powered(backend) == [False]


def test_nan_is_refused():
    """A policy that gives NaN stops the robot at once."""
    backend = loopback()
    rows = RobotRows(Bench1(), backend)
    rows.reset(ROW, NO_VALUES, SEED)
    step = rows.step(None, np.full((1, 1), np.nan))
    assert step.failed[0]
    assert "is not 1 finite angles" in str(rows.stopped)
    assert powered(backend) == [False]
    with pytest.raises(SafetyError, match="no episode is in progress"):
        rows.step(None, np.zeros((1, 1)))
    rows.close()


def test_a_slow_policy_misses_deadlines_and_the_clock_goes_on():
    """Two periods late: two deadlines missed, and the task's phase follows the time."""
    backend = loopback()
    rows = RobotRows(Bench1(), backend)
    rows.reset(ROW, NO_VALUES, SEED)
    clock = backend.guard.driver.clock
    rows.step(None, np.zeros((1, 1)))
    clock.sleep_until(clock.now() + 0.05)
    seen = rows.step(None, np.zeros((1, 1))).observation[0]
    assert rows.note.missed == 2
    assert rows.note.age == pytest.approx(0.05, abs=0.005)
    reference, _ = Bench1().reference(np.array([4 * 0.02]))
    assert seen[2] == pytest.approx(reference[0], abs=1e-9)
    rows.close()


def test_it_parks_before_torque_goes_off(tmp_path):
    """After the block the robot is where it started, and off; after an exception too."""
    backend = loopback()
    with pytest.raises(ZeroDivisionError), HardwareEnv(Bench1(), backend, tmp_path, seed=1) as env:
        start = env.reset()["observation"][0, 0].item()
        env.rollout(40, lambda td: td.set("action", torch.full((1, 1), 0.8)), auto_reset=False,
                    tensordict=env.reset())  # fmt: skip
        raise ZeroDivisionError("a policy's mistake")
    assert (
        "ZeroDivisionError: a policy's" in read_log(tmp_path / "episode-0000.csv").meta["stopped"]
    )
    assert backend.world is not None
    assert powered(backend) == [False]
    assert backend.world.mechanics.angle[0] == pytest.approx(start, abs=0.15)
    env.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_switch_off_at_once(number, tmp_path):
    """Ctrl-C and SIGTERM in the middle of an episode: torque off, handlers restored, logged."""
    backend, before = loopback(), signal.getsignal(number)
    expected = KeyboardInterrupt if number == signal.SIGINT else SystemExit
    with pytest.raises(expected), HardwareEnv(Bench1(), backend, tmp_path) as env:
        env.rollout(5)
        assert powered(backend) == [True]
        os.kill(os.getpid(), number)
        env.rollout(5)
    assert powered(backend) == [False]
    assert signal.getsignal(number) is before
    log = read_log(tmp_path / "episode-0000.csv")
    why = "KeyboardInterrupt" if number == signal.SIGINT else "SystemExit: 143"
    assert (log.meta["stopped"], log.column("flag.stopped").any()) == (why, True)


def test_a_task_of_another_robot_is_refused():
    """Another robot, another rate and a missing sensor are one sentence each, nothing opened."""
    with pytest.raises(RobotError, match=r"Quad8 is a task of the robot 'quad8' .*'bench1'"):
        RobotRows(Quad8(), loopback("bench1"))
    robot = replace(load_robot("bench1"), rate=100.0)
    with pytest.raises(RobotError, match=r"rate 100, but the task runs 50 .*give robot.rate=50"):
        RobotRows(Bench1(), ServoBackend(robot, settle=0.3))
    real = replace(load_robot("quad8"), port="/dev/does-not-exist")
    with pytest.raises(RobotError, match=r"Quad8 observes 'orientation', but quad8 has no such"):
        RobotRows(Quad8(), ServoBackend(real, settle=0.3))


def test_a_pseudo_terminal_is_a_real_port(tmp_path: Path):
    """Through a device file, in real time: armed by hand, driven, parked, off."""
    robot, done, ready = load_robot("bench1"), threading.Event(), threading.Event()
    world, link = EmulatedRobot(robot), tmp_path / "servo"
    server = threading.Thread(target=serve, args=(world, lambda _: ready.set(), done.is_set, link))
    server.start()
    try:
        assert ready.wait(5)
        real = replace(robot, port=str(link), watchdog=2.54)

        def drive() -> None:
            patient = StopLimits(misses=50, patience=5.0, lost=1.0, stale=1.0)
            backend = ServoBackend(real, settle=0.1, limits=patient)
            with HardwareEnv(Bench1(), backend, tmp_path / "logs") as env:
                with pytest.raises(SafetyError, match="not armed"):
                    env.reset()
                env.arm()
                rollout = env.rollout(20)
                if rollout["next", "failed"].any():
                    raise SafetyError("the machine is too busy")
                assert rollout["next", "robot", "fresh"].any()

        in_real_time(drive)
    finally:
        done.set()
        server.join()
    assert world.firmware.torque_on.tolist() == [False]
    meta = read_logs(tmp_path / "logs")[-1].meta
    assert meta["port"] == str(link) and "emulated" not in meta
