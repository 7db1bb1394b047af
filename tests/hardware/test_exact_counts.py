"""Faults of benchmarks/notebook/servos.md once more: what is counted, when it ends, how it is left.

Those of programs that end or are late are in `test_exact_ends.py`.

Virtual time makes all of it exact. A group read that a servo leaves unanswered costs a timeout for
every servo from there on; it is asked again plainly, where the chain ends at the silent servo too.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest

from hardware.driver import Driver
from hardware.emulator.faults import Fault
from hardware.errors import HardwareError, ServoError
from hardware.safety import StopLimits
from tests.hardware.rig import START, Rig, wave


class Case(NamedTuple):
    """A fault, and all that is left of it."""

    faults: tuple[Fault, ...] = ()
    registers: dict[str, dict[str, int]] | None = None
    steps: int = 100
    goal: float | Callable[[int], np.ndarray] = wave
    meddle: Callable[[Rig], None] | None = None  # after 20 steps
    readings: int = 100  # that came through, those before meddling included
    bad: tuple[dict[str, int], ...] = ({}, {}, {})  # what is counted beside asked and answered
    group: Mapping[str, int] = MappingProxyType({})  # the same of answers that servos share
    held: tuple[int, ...] = (0, 0, 0)  # readings for which a servo's last value was held
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


def damage(place: int) -> Fault:
    """Invert this byte of three answers."""
    return Fault("corrupt", start=START, count=3, value=place)


DAMAGED = ({"timeout": 2, "corrupt": 1}, {"timeout": 2, "corrupt": 1}, {"timeout": 1})
SILENT = {f"hinge{i}": {"status_return_level": 1} for i in (1, 2, 3)}
CASES = {
    "nothing": Case(),
    "01 dropped 1 %": Case(
        (Fault("drop", start=START, probability=0.01),), steps=300, readings=300,
        bad=timeouts(3, 3, 4),
    ),
    "01 dropped 5 %": Case((Fault("drop", start=START, probability=0.05),), bad=timeouts(4, 2, 3)),
    # the group's answer, then of the plain answers that are asked for the first two
    "02 header": Case((damage(0),), bad=timeouts(2, 2, 1), held=(1, 1, 0)),
    "02 length": Case((damage(5),), bad=timeouts(2, 2, 1), held=(1, 1, 0)),
    "02 id": Case(  # the second answer seems to come from a servo that is not there
        (damage(4),), bad=({"timeout": 2, "corrupt": 1}, {"timeout": 2}, {"timeout": 1}),
        group={"corrupt": 1}, held=(1, 1, 0),
    ),
    "02 data": Case((damage(9),), bad=DAMAGED, group={"corrupt": 1}, held=(1, 1, 0)),
    "02 crc": Case((damage(-1),), bad=DAMAGED, group={"corrupt": 1}, held=(1, 1, 0)),
    # two reads that nobody understood, and a question for servo 2's health: it says so
    "03 instruction": Case(
        (Fault("corrupt_command", start=START, count=3, value=8),), held=(1, 1, 1),
        bad=({"timeout": 2}, {"timeout": 2, "short": 1, "error": 1}, {"timeout": 2}),
    ),
    # 12 ms: within the drain of the next request
    "04 late": Case(
        (Fault("late", start=START, count=3, value=0.02),), held=(1, 1, 0), group={"foreign": 1},
        bad=tuple({"timeout": n, "stale": 1} for n in (2, 2, 1)),
    ),
    # 20 reads of all and 20 healths in turn
    "04 doubled": Case(
        (Fault("duplicate", start=START, stop=START + 0.4),), group={"foreign": 20},
        bad=tuple({"foreign": n} for n in (6, 7, 7)),
    ),
    "05 another id": Case(
        (Fault("foreign", start=START, count=3, servo=2, value=9),), bad=timeouts(0, 3, 0)
    ),
    "06 one byte": Case(
        (Fault("truncate", start=START, count=3, value=1),), bad=timeouts(2, 2, 1), held=(1, 1, 0)
    ),
    # 5 reads without servo 2, all asked twice; its health, and twice 4 questions whether it is off
    "07 reboot": Case(
        (Fault("reboot", start=START + 0.5, servo=2, count=1),), steps=200, readings=74,
        bad=timeouts(5, 14, 10), held=(0, 4, 4),
        reason="hinge2 gave no new answer 5 times in a row; the robot was stopped, torque is off",
    ),
    "08 low supply": Case(
        (Fault("supply", start=START + 0.5, value=3.6),), steps=200, readings=70,
        reason="hinge3 has 3.6 V, not 5.0 V",
    ),
    # the same for three, who come back during the third attempt; a health read more: the third's
    "08 brown-out": Case(
        (Fault("blackout", start=START + 0.5, stop=START + 0.7),), steps=200, readings=74,
        bad=timeouts(15, 14, 12), held=(4, 4, 4), watchdog=0,
        reason="hinge1 gave no new answer 5 times in a row",
    ),
    "09 heat": Case(
        (Fault("heat", start=START, value=30.0, servo=3),), steps=400, readings=112,
        reason="hinge3 is at 65 °C; let it cool",
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
    assert r.counted() == case.bad
    shared = {k: v for k, v in r.driver.bus_client.group.as_dict().items() if v}
    assert shared == case.group
    assert tuple(np.sum([~x.fresh for x in r.readings], axis=0)) == case.held
    off = case.reason is not None and name != "10 unplugged"
    assert r.powered == [not off] * 3
    tripped = [s.memory["bus_watchdog"] for s in r.world.servos]
    assert tripped == ([5, 0, 5] if name == "07 reboot" else [case.watchdog] * 3)
    assert tuple(r.world.firmware.errors.tolist()) == case.errors


SLOW_BUS = {"baud": 57600, "return_delay": 0.0005, "latency": 0.016}


@pytest.mark.parametrize(
    ("registers", "changes", "asked", "answered"),
    [
        ({"hinge2": {"id": 1}}, {}, (6, 22, 6), (12, 0, 6)),
        ({"hinge3": {"baud_rate": 1}}, {}, (6, 6, 20), (6, 6, 1)),
        ({"hinge2": {"id": 77}}, {}, (6, 22, 6), (6, 0, 6)),
        ({"hinge2": {"model_number": 1060}}, {}, (6, 3, 6), (6, 3, 6)),
        ({"hinge2": {"drive_mode": 8}}, {}, (6, 6, 6), (6, 6, 6)),
        ({"hinge2": {"homing_offset": 100}}, {}, (6, 6, 6), (6, 6, 6)),
        ({"hinge2": {"return_delay_time": 250}}, {}, (6, 6, 6), (6, 6, 6)),
        ({}, {"bus": SLOW_BUS}, (0, 0, 0), (0, 0, 0)),
    ],
    ids=[
        *("05 one ID", "12 speed", "12 missing", "12 wrong type", "20 drive mode"),
        *("20 homing offset", "21 return delay", "21 rate"),
    ],
)
def test_what_a_refusal_asks(rig, chain, monkeypatch, registers, changes, asked, answered):
    """Three pings each, six of the silent and the doubled, then settings; nothing is written.

    The silent are asked once more with much patience: their link may be slow. At each of five other
    speeds they are asked up to three times.
    """
    made: list[Driver] = []
    original = Driver.connect

    def connect(self: Driver) -> None:
        made.append(self)
        original(self)

    monkeypatch.setattr(Driver, "connect", connect)
    monkeypatch.setattr(Driver, "configure", lambda self: pytest.fail("written to"))
    with pytest.raises(ServoError):
        rig(robot=chain(3, **changes), registers=registers)
    (driver,) = made
    counters = [driver.bus_client.counters[n] for n in driver.ids]
    assert tuple(c.asked for c in counters) == asked
    assert tuple(c.answered for c in counters) == answered
    world: Any = driver.bus_client.port
    assert not world.world.firmware.torque_on.any()


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
        r = rig(*random_faults(rng), limits=StopLimits(misses=10**6, stray=9.0, odd_voltage=9.0))
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
