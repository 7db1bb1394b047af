"""Faults of the emulated robot and its bus, by schedule.

    faults = [Fault("drop", probability=0.02), Fault("reboot", start=3.0, servo=1, count=1)]
    world = World(robot, faults=faults)

On the wire, whenever a packet passes between `start` and `stop` (with `probability`, at most
`count` times; `servo`: only answers of that ID):

    drop            an answer is lost
    corrupt         an answer's byte number `value` is inverted (negative: from the end)
    corrupt_command the same for what the host writes
    drop_command    what the host writes is lost
    truncate        an answer ends after `value` bytes
    late            an answer comes `value` seconds late
    duplicate       an answer comes twice
    foreign         an answer carries the ID `value`, its CRC right
    noise           `value` random bytes come before an answer

In the servos, at `start`:

    reboot          a servo reboots
    stuck           its joint does not move until `stop`
    slip            its horn slips by `value` rad
    heat            it warms by `value` K/s until `stop`
    supply          the servo's supply, and that of all that share it, is `value` volts until `stop`
    blackout        no supply until `stop`; then all servos reboot
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from hardware.errors import RobotError, did_you_mean, format_names
from hardware.protocol import crc16

AnswerKind = Literal["drop", "corrupt", "truncate", "late", "duplicate", "foreign", "noise"]
CommandKind = Literal["corrupt_command", "drop_command"]
ServoKind = Literal["reboot", "stuck", "slip", "heat", "supply", "blackout"]
Kind = AnswerKind | CommandKind | ServoKind
KINDS = (*get_args(AnswerKind), *get_args(CommandKind), *get_args(ServoKind))


@dataclass(frozen=True)
class Fault:
    """One fault; the module says what each kind does.

    Raises:
        RobotError: an unknown kind, or a number out of its range.
    """

    kind: Kind  # what happens
    start: float = 0.0  # the time from which it acts [s]
    stop: float = math.inf  # the time until which it acts [s]
    servo: int | None = None  # the ID that it concerns; None for all
    probability: float = 1.0  # the probability that it hits a packet, in [0, 1]
    count: int | None = None  # the largest number of packets that it hits; None for any
    value: float = 0.0  # the kind's own number

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            hint = did_you_mean(self.kind, KINDS)
            raise RobotError(f"unknown fault {self.kind!r}{hint}; available: {format_names(KINDS)}")
        if not 0 <= self.probability <= 1:
            raise RobotError(f"fault {self.kind}: probability {self.probability} is not in [0, 1]")
        if not self.start <= self.stop:
            raise RobotError(f"fault {self.kind}: it stops at {self.stop}, before {self.start}")


class Faults:
    """A schedule of faults on the wire.

    Args:
        faults: the schedule.
        rng: the random generator of probabilities and noise.
    """

    def __init__(self, faults: Sequence[Fault], rng: np.random.Generator) -> None:
        self._faults, self._rng = list(faults), rng
        self._times = [0] * len(self._faults)
        self._commands = any(f.kind in get_args(CommandKind) for f in self._faults)
        self._answers = any(f.kind in get_args(AnswerKind) for f in self._faults)

    def incoming(self, data: bytes, now: float) -> bytes:
        """Return the bytes that reach the servos of those that the host writes at `now` [s]."""
        if not self._commands:
            return data
        for fault in self._striking(get_args(CommandKind), None, now):
            data = b"" if fault.kind == "drop_command" else _inverted(data, int(fault.value))
        return data

    def outgoing(self, data: bytes, servo: int, now: float) -> list[tuple[float, bytes]]:
        """Return (delay [s], bytes) that the host gets of a servo's answer at `now` [s]."""
        if not self._answers:
            return [(0.0, data)]
        late, copies = 0.0, 1
        for fault in self._striking(get_args(AnswerKind), servo, now):
            match fault.kind:
                case "drop":
                    copies = 0
                case "duplicate":
                    copies = 2
                case "late":
                    late = fault.value
                case "truncate":
                    data = data[: int(fault.value)]
                case "corrupt":
                    data = _inverted(data, int(fault.value))
                case "foreign":
                    data = _renamed(data, int(fault.value))
                case "noise":
                    data = self._rng.bytes(int(fault.value)) + data
        return [(late, data)] * copies

    def _striking(self, kinds: tuple[str, ...], servo: int | None, now: float) -> list[Fault]:
        """Return the faults that strike this packet, and count them."""
        found = []
        for i, fault in enumerate(self._faults):
            if fault.kind not in kinds or not fault.start <= now < fault.stop:
                continue
            if servo is not None and fault.servo not in (None, servo):
                continue
            if fault.count is not None and self._times[i] >= fault.count:
                continue
            if fault.probability < 1 and self._rng.random() >= fault.probability:
                continue
            self._times[i] += 1
            found.append(fault)
        return found


def _inverted(data: bytes, place: int) -> bytes:
    if not -len(data) <= place < len(data):
        return data
    changed = bytearray(data)
    changed[place] ^= 0xFF
    return bytes(changed)


def _renamed(data: bytes, number: int) -> bytes:
    body = data[:4] + bytes([number]) + data[5:-2]
    return body + crc16(body).to_bytes(2, "little")
