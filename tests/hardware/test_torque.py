"""A torque-off that has begun is finished, and torque never goes on with an old goal."""

import logging
import os
import signal

import numpy as np
import pytest

from hardware.emulator.faults import Fault
from hardware.errors import SafetyError, ServoError
from hardware.safety import StopLimits
from tests.hardware.rig import START, wave


@pytest.fixture
def absence(monkeypatch):
    """Return a function that unplugs a rig for a time and sends signals at moments of it [s]."""

    def begin(r, away: float, **signals: float) -> None:
        left = {getattr(signal, name): r.clock.now() + at for name, at in signals.items()}
        back, sleep = r.clock.now() + away, r.clock.sleep_until

        def go_on(moment: float) -> None:
            sleep(moment)
            r.port.unplugged = r.clock.now() < back
            for number in [n for n, at in left.items() if at <= r.clock.now()]:
                del left[number]
                os.kill(os.getpid(), number)

        monkeypatch.setattr(r.clock, "sleep_until", go_on)
        r.port.unplugged = True

    before = signal.getsignal(signal.SIGINT)
    yield begin
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize(
    ("signals", "expected"),
    [
        ({"SIGINT": 0.8}, KeyboardInterrupt),
        ({"SIGTERM": 0.8}, SystemExit),
        ({"SIGINT": 0.3, "SIGTERM": 0.8}, KeyboardInterrupt),
    ],
)
def test_signals_do_not_break_a_torque_off(rig, absence, signals, expected):
    """The cable is out, the guard tries to switch off, signals come, the cable is back: off."""
    r = rig()
    with pytest.raises(expected), r.guard:
        r.run(20, wave)
        absence(r, 1.8, **signals)
        r.guard.read()
    assert r.powered == [False] * 3


def test_a_second_signal_while_the_first_switches_off(rig, absence):
    """Ctrl-C begins to switch off, the cable is out, SIGQUIT comes: torque goes off."""
    r = rig()
    with pytest.raises(KeyboardInterrupt), r.guard:
        r.run(20, wave)
        absence(r, 1.8, SIGQUIT=0.8)
        os.kill(os.getpid(), signal.SIGINT)
    assert r.powered == [False] * 3


def test_a_signal_is_acted_on_though_its_torque_off_failed(rig, absence):
    """What may be powered is the error; where the caller takes it, the signal still ends him."""
    r = rig(limits=StopLimits(return_time=1.0))
    with pytest.raises(SystemExit) as ending, r.guard:
        r.run(20, wave)
        absence(r, 9.0, SIGTERM=0.5)
        with pytest.raises(SafetyError, match="may still be powered"):
            r.guard.read()
        assert r.clock.now() < 9.0
    assert ending.value.code == 128 + signal.SIGTERM


@pytest.mark.parametrize(
    ("watchdog", "words"),
    [(0.1, "stops after 0.1 s"), (0.03, "stops after 0.04 s"), (0.0, "no watchdog")],
)
def test_the_last_words_say_who_may_be_powered(rig, chain, absence, caplog, watchdog, words):
    """Where the bus stays away the servos are named, and what they do alone; arming said it."""
    r = rig(robot=chain(3, watchdog=watchdog))
    with caplog.at_level(logging.INFO):
        r.run(20, wave)
    assert f"'hinge1', 'hinge2', 'hinge3' (each {'has ' * (not watchdog)}{words}" in caplog.text
    absence(r, 60.0)
    with pytest.raises(
        SafetyError, match=rf"within 4 s .*'hinge1', 'hinge2', 'hinge3' \(.*{words}"
    ):
        r.guard.read()
    assert "holds" in caplog.text and "cut the supply" in caplog.text


def test_how_long_it_retries_is_a_setting(rig, absence):
    """Ten seconds of patience outlast a cable that is out for nine."""
    r = rig(limits=StopLimits(return_time=10.0))
    r.run(20, wave)
    absence(r, 9.0)
    with pytest.raises(SafetyError, match="it came back, and torque is off"):
        r.guard.read()
    assert r.powered == [False] * 3


def test_the_next_program_says_what_was_left_on(rig, caplog):
    """A killed program leaves torque on; who connects next is told so before anything else."""
    r = rig()
    r.run(20, wave)
    r.start_again()
    assert caplog.messages[0].endswith("torque is on in 'hinge1', 'hinge2', 'hinge3', left on by "
                                       "an earlier program")  # fmt: skip
    assert r.powered == [False] * 3


def test_one_servo_gone_is_named_and_the_others_are_off(rig):
    """A servo that answers nothing any more is named; only it may keep its torque."""
    r = rig(Fault("drop", servo=2, start=START))
    with pytest.raises(SafetyError, match=r"hinge2 does not report.*'hinge2' \(each stops"):
        r.run(100, wave)
    assert not r.powered[0] and not r.powered[2]


def test_arming_an_armed_robot_that_fails_stops_it(rig):
    """Arming again, with a joint outside its limits by now, leaves no torque on."""
    r = rig()
    r.run(20)
    r.world.mechanics.data.qpos[:] = [0.0, 2.6, 0.0]
    r.world.mechanics.lock(1, True)
    r.clock.sleep_until(r.clock.now() + 0.005)
    with pytest.raises(SafetyError, match=r"hinge2 is at 2.*outside its limits"):
        r.guard.arm()
    assert r.powered == [False] * 3


def test_a_lost_goal_makes_no_jump(rig):
    """A robot that swung and is caught again stays where it is, though the packet is lost."""
    r = rig()
    r.run(60, lambda k: np.full(3, min(0.03 * k, 1.2)))
    r.guard.release_torque()
    r.world.mechanics.data.qpos[:], r.world.mechanics.data.qvel[:] = 0.0, 0.0
    r.clock.sleep_until(r.clock.now() + 0.1)
    r.world.advance(r.clock.now())
    at = r.world.mechanics.angle.copy()
    assert np.abs(at).max() < 0.01
    real, lost = r.driver.bus_client.sync_write, []
    r.driver.bus_client.sync_write = lambda *words: lost.append(words)
    r.guard.restore_torque()
    r.driver.bus_client.sync_write = real
    goals = np.array([s.memory["goal_position"] for s in r.world.servos])
    np.testing.assert_array_equal(goals, r.guard._sent[-1][1])
    fastest = 0.0
    for _ in range(40):
        r.world.advance(r.clock.now() + 0.005)
        r.clock.sleep_until(r.world.time)
        fastest = max(fastest, np.abs(r.world.firmware.velocity).max())
    assert r.powered == [True] * 3
    assert np.abs(r.world.mechanics.angle - at).max() < 0.01
    assert fastest < 0.1


def test_a_servo_that_refuses_its_goal_gets_no_torque(rig):
    """Where a goal cannot be read back, stiffening stops the robot instead."""
    r = rig()
    r.run(20)
    r.guard.release_torque()
    write = r.driver.write_register

    def lose(servo, name, value):
        if name == "goal_position" and servo.name == "hinge2":
            raise ServoError("hinge2 (ID 2): goal_position could not be set")
        write(servo, name, value)

    r.driver.write_register = lose
    with pytest.raises(SafetyError, match="goal_position could not be set"):
        r.guard.restore_torque()
    r.driver.write_register = write
    assert r.powered == [False] * 3


def test_torque_off_is_verified_over_a_slow_link(rig):
    """Answers that come 150 ms late are waited for, longer with each attempt."""
    r = rig(Fault("late", start=START, value=0.15))
    slow = r"torque is off; the link is slow: answers come 1\d\d ms later than the wire explains"
    with pytest.raises(SafetyError, match=slow):
        r.run(200, wave)
    assert r.powered == [False] * 3
    assert r.driver.powered == set()


@pytest.mark.parametrize("rate", [5.0, 50.0])
def test_a_slow_link_is_called_slow(rig, chain, rate):
    """150 ms are named as what they are: before connecting, and where goals come late."""
    with pytest.raises(ServoError, match=r"hinge1 answers 1\d\d ms later.*: the link is slow"):
        rig(Fault("late", value=0.15), robot=chain(3, rate=rate, watchdog=0.5))
    r = rig(robot=chain(3, rate=rate, watchdog=0.5))
    r.run(1)
    send, waiting = r.driver.bus_client.sync_write, []

    def late(*words) -> None:
        waiting.append(words)
        if len(waiting) > 8:
            send(*waiting.pop(0))

    r.driver.bus_client.sync_write = late
    with pytest.raises(SafetyError, match=r"was sent \d+ ms later: the link is slow"):
        r.run(60, wave)
    assert r.powered == [False] * 3
