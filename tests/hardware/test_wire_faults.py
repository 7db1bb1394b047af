"""What goes wrong on the wire, one test each: counted, survived, and never a wrong value.

The numbers are those of the list in benchmarks/notebook/servos.md.
"""

import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.emulator.faults import Fault
from hardware.errors import SafetyError, ServoError
from tests.hardware.rig import START, wave


def test_01_dropped_answers(rig):
    """Lost answers are counted, asked for once more, and the last value is held meanwhile."""
    r = rig(Fault("drop", start=START, probability=0.05))
    r.run(300, wave)
    assert r.powered == [True] * 3
    assert all(np.isfinite(x.position).all() for x in r.readings)
    assert sum(r.count("timeout")) > 10
    assert sum(r.count("answered")) + sum(r.count("timeout")) == sum(r.count("asked"))
    fresh = np.mean([x.fresh for x in r.readings])
    assert fresh > 0.97


LOST = {"timeout": 3}


@pytest.mark.parametrize(
    ("fault", "value", "servos", "group"),
    [
        ("drop", 0, LOST, {}),
        ("corrupt", 9, LOST, {"corrupt": 1}),
        ("corrupt", 5, LOST, {}),
        ("corrupt", -1, LOST, {"corrupt": 1}),
        ("truncate", 0, LOST, {}),
        ("truncate", 1, LOST, {}),
        ("late", 0.012, LOST, {}),
        ("late", 0.1, {"timeout": 3, "stale": 3}, {"foreign": 1}),
        ("foreign", 9, LOST, {}),
        ("duplicate", 0, {}, {"foreign": 1}),
        ("noise", 7, {}, {}),
        ("corrupt_command", 8, LOST, {}),
        ("drop_command", 0, LOST, {}),
    ],
)
def test_01_to_06_one_fault_exactly(rig, fault, value, servos, group):
    """One fault in a group read of three servos is counted exactly, and costs no reading.

    A lost answer is one timeout each and one retry. An answer that comes 0.1 s late, in place of
    another, is whole but stale, and asked for again.
    """
    r = rig(Fault(fault, start=START, count=1, value=value))
    r.run(70, wave)
    client = r.driver.bus_client
    kinds = ("timeout", "corrupt", "short", "foreign", "stale", "error")
    counted = {kind: sum(r.count(kind)) for kind in kinds}
    assert counted == dict.fromkeys(kinds, 0) | servos
    shared = {kind: getattr(client.group, kind) for kind in kinds}
    assert shared == dict.fromkeys(kinds, 0) | group
    assert (9 in client.counters) == (fault == "foreign")
    assert np.all([x.fresh for x in r.readings])
    assert r.powered == [True] * 3


@pytest.mark.parametrize("place", [0, 2, 3, 4, 5, 6, 7, 8, 9, -1])
def test_02_corrupted_answers(rig, place):
    """A damaged byte anywhere in answers costs retries, never an exception or a wrong value."""
    r = rig(Fault("corrupt", start=START, stop=START + 0.1, value=place))
    r.run(80, wave)
    assert r.powered == [True] * 3
    track = np.array([x.position[0] for x in r.readings])
    assert np.abs(np.diff(track)).max() < 0.1
    assert r.readings[-1].fresh.all()


@pytest.mark.parametrize(
    ("fault", "value", "servo", "counted"),
    [
        ("corrupt_command", 8, None, ("timeout", "error")),  # a CRC error, without data
        ("foreign", 9, 2, None),  # under another ID, never a value
        *[("truncate", length, None, ("timeout",)) for length in (0, 1, 5, 9, 11)],
    ],
)
def test_03_05_06_answers_that_are_none(rig, fault, value, servo, counted):
    """Corrupted instructions, answers of another ID or cut short: counted and asked again."""
    r = rig(Fault(fault, start=START, stop=START + 0.06, servo=servo, value=value))
    r.run(80, wave)
    assert r.powered == [True] * 3
    assert counted is None or sum(sum(r.count(kind)) for kind in counted) > 0
    assert r.readings[-1].fresh.all()


@pytest.mark.parametrize("late", [0.003, 0.012, 0.02, 0.025, 0.04])
def test_04_late_answers_are_never_fresh(rig, late):
    """Late answers, whenever they come, are not taken for new ones; the last value is held."""
    r = rig(Fault("late", start=START, stop=START + 0.3, value=late))
    pairs = []
    original = r.driver.read

    def read():
        reading = original()
        pairs.append((reading, r.world.firmware.count.copy()))
        return reading

    r.driver.read = read
    try:
        r.run(100, lambda k: np.full(3, 0.8 * np.sin(k / 6)))
    except SafetyError as error:
        assert "no new answer" in str(error) or "does not report" in str(error)
        assert r.powered == [False] * 3
    for reading, true in pairs:
        off = np.abs(reading.count - true)[reading.fresh]
        assert off.max(initial=0) < 40  # 6 ms at the fastest


def test_04_duplicates_are_never_fresh(rig):
    """Doubled answers are thrown away before the next request."""
    r = rig(Fault("duplicate", start=START, stop=START + 0.4))
    r.run(80, wave)
    counts = np.array([x.count[0] for x in r.readings])
    assert all(x.fresh.all() for x in r.readings)
    assert np.ptp(counts) > 300


def test_05_two_servos_of_one_id(rig):
    """Two servos of one ID are refused before torque goes on."""
    with pytest.raises(ServoError, match="several servos answer as 1"):
        rig(registers={"hinge2": {"id": 1}})


@pytest.mark.parametrize("times", [1, 4])
def test_a_servo_at_another_speed_is_found_on_a_busy_machine(rig, times):
    """Its answers come later than usual, as on a busy machine: the speed is named all the same."""
    late = Fault("late", servo=3, value=times * VirtualClock.jitter)
    with pytest.raises(ServoError, match=r"'3 \(hinge3\)'; found: 3 at 57600 bits/s"):
        rig(late, registers={"hinge3": {"baud_rate": 1}})
