"""Whatever ends the program, torque goes off first."""

import gc
import os
import signal

import pytest

from tests.hardware.rig import wave


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT], ids=lambda n: n.name
)
def test_16_signals(rig, number):
    """Ctrl-C, kill and a closed terminal switch torque off before anything else happens."""
    r = rig()
    expected = KeyboardInterrupt if number == signal.SIGINT else SystemExit
    usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    outside = signal.signal(number, usual)  # a shell's background job may be told to ignore it
    try:
        with pytest.raises(expected), r.guard:
            r.run(10, wave)
            assert r.powered == [True] * 3
            os.kill(os.getpid(), number)
            r.run(10, wave)
        assert r.powered == [False] * 3
        assert signal.getsignal(number) is usual
    finally:
        signal.signal(number, outside)


def test_16_a_program_that_outlives_its_terminal(rig):
    """Under nohup a closed terminal ends nothing."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        r = rig()
        with r.guard:
            r.run(10, wave)
            os.kill(os.getpid(), signal.SIGHUP)
            r.run(10, wave)
            assert r.powered == [True] * 3
    finally:
        signal.signal(signal.SIGHUP, before)


def test_the_collector_looks_at_new_objects_only(rig):
    """While the robot is guarded, what was there before is frozen; afterwards it is not."""
    r = rig()
    assert gc.get_freeze_count() == 0
    with r.guard:
        assert gc.get_freeze_count() > 10_000
    assert gc.get_freeze_count() == 0
