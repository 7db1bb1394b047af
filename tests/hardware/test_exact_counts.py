"""Faults 7 to 22 of docs/hardware.md once more: what is counted, when it ends, how it is left.

Virtual time makes all of it exact. A group read that a servo leaves unanswered costs a timeout for
every servo from there on; it is asked again plainly, where the chain ends at the silent servo too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from hardware.driver import Driver
from hardware.emulator.faults import Fault
from hardware.errors import HardwareError, ServoError
from hardware.safety import Policy
from tests.hardware.rig import START, Rig, wave

FINE = ("asked", "answered")


class Case(NamedTuple):
    """A fault, and all that is left of it."""

    faults: tuple[Fault, ...] = ()
    registers: dict[str, dict[str, int]] | None = None
    steps: int = 100
    goal: float | Callable[[int], np.ndarray] = wave
    meddle: Callable[[Rig], None] | None = None  # after 20 steps
    readings: int = 100  # that came through, those before meddling included
    bad: tuple[dict[str, int], ...] = ({}, {}, {})  # what is counted beside asked and answered
    watchdog: int = 5  # steps of 20 ms; -1: tripped; 0: off
    errors: tuple[int, ...] = (0, 0, 0)
    reason: str | None = None  # why it was stopped; None: it goes on


def overload(r: Rig) -> None:
    """Let a servo shut itself down."""
    r.world.firmware.shut_down(1, 0x20)


def stall(r: Rig) -> None:
    """Do nothing for 0.3 s."""
    r.clock.sleep_until(r.clock.now() + 0.3)


def unplug(r: Rig) -> None:
    """Pull the cable."""
    r.port.unplugged = True


def nan(r: Rig) -> None:
    """Command what is no number."""
    r.guard.command(np.array([0.0, np.nan, 0.0]))


def timeouts(*counts: int) -> tuple[dict[str, int], ...]:
    """Return nothing but timeouts."""
    return tuple({"timeout": n} if n else {} for n in counts)


SILENT = {f"hinge{i}": {"status_return_level": 1} for i in (1, 2, 3)}
CASES = {
    "nothing": Case(),
    # 5 reads without servo 2, all asked twice; its health, and 4 attempts to hear it is off
    "07 reboot": Case(
        (Fault("reboot", start=START + 0.5, servo=2, count=1),), steps=200, readings=74,
        bad=timeouts(5, 15, 10),
        reason="hinge2 gave no new answer 5 times in a row; and",
    ),
    "08 low supply": Case(
        (Fault("supply", start=START + 0.5, value=3.6),), steps=200, readings=70,
        reason="hinge3 has 3.6 V, not 5.0 V",
    ),
    # the same for three; one health read more: the third servo's turn
    "08 brown-out": Case(
        (Fault("blackout", start=START + 0.5, stop=START + 0.7),), steps=200, readings=74,
        bad=timeouts(15, 15, 16), watchdog=0, reason="hinge1 gave no new answer 5 times in a row",
    ),
    "09 heat": Case(
        (Fault("heat", start=START, value=30.0, servo=3),), steps=400, readings=112,
        reason="hinge3 has 65 °C; let it cool",
    ),
    # seen in the first read; the health that names it, and torque off twice over, carry the bit too
    "09 overload": Case(
        goal=0.0, meddle=overload, readings=20, bad=({}, {"alert": 4}, {}), errors=(0, 32, 0),
        reason="hinge2 reports 'overload'",
    ),
    "10 unplugged": Case(meddle=unplug, readings=20, reason="is the cable in"),
    "11 stuck": Case(
        (Fault("stuck", start=START, servo=2),), steps=200, readings=91,
        goal=lambda k: np.full(3, min(0.02 * k, 1.9)), reason="hinge2 is at 0.78 rad and should",
    ),
    "11 slip": Case((Fault("slip", start=START, servo=1, value=0.3),), goal=0.0),
    # two probes of fast reads, once, at the handshake
    "13 old firmware": Case(registers={"hinge2": {"firmware_version": 40}}, bad=timeouts(2, 2, 2)),
    # each of 9 writes to a servo: torque off, 4 registers, watchdog off, goal, watchdog, torque on
    "13 silent writes": Case(registers=SILENT, bad=timeouts(9, 9, 9)),
    "14 watchdog": Case(meddle=stall, readings=20, watchdog=-1, reason="its bus watchdog tripped"),
    "17 no number": Case(meddle=nan, readings=20, reason="is not 3 finite angles"),
    "17 wild": Case(goal=1e9),
    "19 refused goal": Case(
        registers={"hinge2": {"max_position_limit": 2200}}, goal=0.8, readings=6,
        reason="hinge2 does not take its goals: it holds 2152, 2570 was sent",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_a_fault_leaves(rig, name):
    """Counters of each servo, readings until the stop, its reason, torque, watchdogs, errors."""
    case = CASES[name]
    r = rig(*case.faults, registers=case.registers)
    reason = None
    try:
        if case.meddle is not None:
            r.run(20, case.goal)
            case.meddle(r)
        r.run(case.steps - len(r.readings), case.goal)
    except HardwareError as error:
        reason = str(error)
    assert (reason is None) == (case.reason is None), reason
    assert case.reason is None or case.reason in str(reason)
    assert len(r.readings) == case.readings
    assert counted(r.driver) == case.bad
    assert not any(r.driver.line.group.as_dict().values())
    off = case.reason is not None and name != "10 unplugged"
    assert r.powered == [not off] * 3
    tripped = [s.memory["bus_watchdog"] for s in r.world.servos]
    assert tripped == ([5, 0, 5] if name == "07 reboot" else [case.watchdog] * 3)
    assert tuple(r.world.firmware.errors.tolist()) == case.errors


def counted(driver: Driver) -> tuple[dict[str, int], ...]:
    """Return what was counted of each servo beside requests and answers."""
    found = []
    for number in driver.ids:
        counters = driver.line.counters[number]
        lost = counters.asked - counters.answered
        assert lost == counters.timeout
        found.append({k: v for k, v in counters.as_dict().items() if v and k not in FINE})
    return tuple(found)


@pytest.mark.parametrize(
    ("registers", "asked", "answered"),
    [
        ({"hinge3": {"baud_rate": 1}}, (3, 3, 8), (3, 3, 1)),
        ({"hinge2": {"id": 77}}, (3, 8, 3), (3, 0, 3)),
        ({"hinge2": {"drive_mode": 8}}, (6, 4, 3), (6, 4, 3)),
        ({"hinge2": {"homing_offset": 100}}, (6, 5, 3), (6, 5, 3)),
        ({"hinge2": {"return_delay_time": 250}}, (6, 6, 3), (6, 6, 3)),
    ],
    ids=["12 speed", "12 missing", "20 drive mode", "20 homing offset", "21 return delay"],
)
def test_what_a_refusal_asks(rig, monkeypatch, registers, asked, answered):
    """Three pings each, then other speeds or settings; nothing is written, torque is never on."""
    made: list[Driver] = []
    original = Driver.connect

    def connect(self: Driver) -> None:
        made.append(self)
        original(self)

    monkeypatch.setattr(Driver, "connect", connect)
    monkeypatch.setattr(Driver, "configure", lambda self: pytest.fail("written to"))
    with pytest.raises(ServoError):
        rig(registers=registers)
    (driver,) = made
    counters = [driver.line.counters[n] for n in driver.ids]
    assert tuple(c.asked for c in counters) == asked
    assert tuple(c.answered for c in counters) == answered
    world: Any = driver.line.port
    assert not world.world.firmware.torque_on.any()


@pytest.mark.parametrize("late", [0.004, 0.006, 0.008, 0.02])
def test_05_a_late_answer_is_no_second_servo(rig, late):
    """An answer to a ping that comes with the next one's is not taken for another servo's."""
    r = rig(Fault("late", count=1, value=late))
    r.run(5)
    assert r.powered == [True] * 3


def test_22_ten_seconds_of_twelve_servos(chain):
    """Every request is answered: one group read a step and one servo's health in turn."""
    r = Rig(chain(12))
    before = [r.driver.line.counters[n].asked for n in r.driver.ids]
    r.run(500, lambda k: np.full(12, 0.3 * np.sin(k / 20)))
    assert counted(r.driver) == ({},) * 12
    asked = np.array([r.driver.line.counters[n].asked for n in r.driver.ids]) - before
    healths = np.array([500 // 12 + (1 <= i <= 500 % 12) for i in range(12)])
    np.testing.assert_array_equal(asked - healths, np.full(12, asked[0] - healths[0]))
    assert (
        asked[0] - healths[0] == 500 + 1 + 1 + 8
    )  # arming: a reading, a health, 4 writes, read back


SMALL, LARGE = 10, pytest.param(300, marks=[pytest.mark.slow, pytest.mark.timeout(1800)])


@pytest.mark.parametrize("runs", [SMALL, LARGE])
def test_old_and_doubled_answers_are_never_taken(rig, runs):
    """Answers late by anything, doubled and lost at random: what counts as new is of this read.

    The servos turn all the time. Each position that is called new must be one that the servo had
    between 5 ms before it was asked (what its clock can tell) and the end of the read.
    """
    taken = held = 0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        r = rig(*random_faults(rng), policy=Policy(misses=10**6, stray=9.0, odd_voltage=9.0))
        history = watched(r)
        r.run(75, lambda k: np.full(3, 0.9 * np.sin(k / 6)))
        for asked, done, reading in history.reads:
            first, last = round(1000 * asked) - 5, round(1000 * done) + 1
            true = np.array(history.counts[max(first, 0) : last + 1])  # (ticks, 3)
            for i in np.flatnonzero(reading.fresh):
                assert reading.count[i] in true[:, i], (seed, asked, i)
            taken, held = taken + int(reading.fresh.sum()), held + int((~reading.fresh).sum())
    assert held > 2 * runs  # the faults did hit
    assert taken > 20 * held / 10


class History:
    """Each servo's position at every millisecond, and each read with its beginning and end."""

    def __init__(self) -> None:
        self.counts: list[np.ndarray] = []
        self.reads: list[tuple[float, float, Any]] = []


def watched(r: Rig) -> History:
    """Write down what the servos' encoders say, and what the driver reads."""
    history, firmware, driver = History(), r.world.firmware, r.driver
    tick, read = firmware.tick, driver.read
    history.counts += [firmware.count.copy()] * firmware.ticks

    def ticked() -> None:
        tick()
        history.counts.append(firmware.count.copy())

    def reading() -> Any:
        asked = r.clock.now()
        result = read()
        history.reads.append((asked, r.clock.now(), result))
        return result

    firmware.tick, driver.read = ticked, reading  # type: ignore[method-assign]
    return history


def random_faults(rng: np.random.Generator) -> list[Fault]:
    """Draw twelve faults of answers over the second after the start."""
    faults = []
    for _ in range(12):
        start = START - 0.6 + rng.uniform(0, 1.0)
        servo = None if rng.random() < 0.4 else int(rng.integers(1, 4))
        common = {"start": start, "stop": start + rng.uniform(0.02, 0.2), "servo": servo}
        kind = ("late", "late", "late", "duplicate", "drop")[rng.integers(5)]
        late = float(rng.choice([rng.uniform(0, 0.006), rng.uniform(0, 0.03), rng.uniform(0, 0.3)]))
        chance = float(rng.choice([0.2, 0.6, 1.0]))
        faults.append(Fault(kind, probability=chance, value=late, **common))
    return faults
