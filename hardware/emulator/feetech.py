"""A Feetech bus that is not there: STS servos with the physics and firmware of the emulator.

    world = EmulatedRobot(load_robot("so101"))    # inner servos, see `feetech_inner.py`
    FeetechBus(world).feed(packet(1, PING), now=0.0, baud=1_000_000)

What a servo makes of an instruction is in `feetech_servo.py`. As on an STS3215, an instruction that
a servo does not know is not answered, and neither is a reboot. Assumed: answers of 50 us after the
return delay.
"""

from collections.abc import Iterator

from hardware.config import Robot
from hardware.emulator.bus import TURN_ROUND, Arrival, Bus, Steps
from hardware.emulator.feetech_inner import InnerServo
from hardware.emulator.feetech_servo import MIDDLE, FeetechServo
from hardware.emulator.world import EmulatedRobot
from hardware.feetech import protocol
from hardware.protocol import BROADCAST, Packet


class FeetechBus(Bus):
    """The wire between a host and the Feetech servos of a world; see `Bus`.

    Args:
        world: a world with inner servos.
        part: the part of the world's robot whose servos are on this bus; None for all of them.
    """

    def __init__(self, world: EmulatedRobot, part: Robot | None = None) -> None:
        super().__init__(world, part)
        self._parser = protocol.Parser(answers=False)
        self.shells = []
        for servo, core in zip(self.part.servos, self._servos, strict=True):
            assert isinstance(servo, InnerServo)
            self.shells.append(FeetechServo(servo, core, world.firmware, self.part.bus.baud))

    def _handle(self, packet: Packet) -> Steps:
        if not packet.ok:
            return []
        if packet.instruction == protocol.SYNC_READ and len(packet.params) > 2:
            return (yield from self._read_in_turn(packet.params))
        return self._obey(packet)

    def _obey(self, packet: Packet) -> list[Arrival]:
        if packet.instruction == protocol.SYNC_WRITE and len(packet.params) > 2:
            return self._write_each(packet.params)
        answers = []
        for shell in sorted(self._listening(packet.id), key=lambda s: s["id"]):
            if self._lost():
                continue
            data = self._execute(shell, packet)
            silent = packet.id == BROADCAST and packet.instruction != protocol.PING
            if data is not None and not silent:
                number = shell["id"] if packet.id == BROADCAST else packet.id
                answers.append((shell, protocol.status(number, shell.errors, data)))
        return self._give(answers)

    def _execute(self, shell: FeetechServo, packet: Packet) -> bytes | None:
        """Let a servo carry out an instruction; return its answer's data, None for no answer."""
        shell.wake()
        params, now, level = packet.params, self._free, shell["status_return_level"]
        match packet.instruction:
            case protocol.PING:
                return b""
            case protocol.READ if len(params) == 2:
                return shell.read(*params)
            case protocol.WRITE if len(params) > 1:
                shell.write(params[0], params[1:], now)
            case protocol.REG_WRITE if len(params) > 1:
                shell.register(params[0], params[1:])
            case protocol.ACTION:
                shell.act(now)
            case protocol.RESET:
                shell.reset(now)
            case protocol.CALIBRATE if len(params) in (0, 2):
                shell.calibrate(int.from_bytes(params, "little") if params else MIDDLE, now)
            case protocol.REBOOT:
                shell.reboot(now)
                return None
            case _:
                return None
        return b"" if level else None

    def _read_in_turn(self, params: bytes) -> Steps:
        """Answers of several servos, one after the other, each sampled as it starts."""
        address, size = params[:2]
        when, answers = self._free, []
        for number in params[2:]:
            shell = next(self._listening(number), None)
            if shell is None or self._lost():
                continue
            when += shell.return_delay + TURN_ROUND
            yield when
            answers.append(
                (shell, protocol.status(number, shell.errors, shell.read(address, size)))
            )
            when += len(answers[-1][1]) * self._byte
        return self._give(answers)

    def _write_each(self, params: bytes) -> list[Arrival]:
        address, size = params[:2]
        body = params[2 : 2 + (len(params) - 2) // (size + 1) * (size + 1)]
        for i in range(0, len(body), size + 1):
            for shell in self._listening(body[i]):
                if not self._lost():
                    shell.write(address, body[i + 1 : i + 1 + size], self._free)
        return []

    def _give(self, answers: list[tuple[FeetechServo, bytes]]) -> list[Arrival]:
        return self._send([(shell.core, data) for shell, data in answers])

    def _listening(self, number: int) -> Iterator[FeetechServo]:
        for shell in self.shells:
            called = number in (BROADCAST, shell["id"]) and shell.baud == self._baud
            if called and not self._world.is_silent(shell.core, self._free):
                yield shell
