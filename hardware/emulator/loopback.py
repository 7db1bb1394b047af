"""The emulated bus as a port of dynamixel-sdk, in this process and in virtual time.

    port = LoopbackPort(EmulatedRobot(load_robot("bench1")), VirtualClock())
    port.openPort()
    PacketHandler(2.0).ping(port, 1)        # the SDK's own code over the emulator's bytes

Waiting for bytes moves the clock to their arrival, or to the end of the packet's timeout. Nothing
depends on how fast this machine is. Of a robot with several buses each has a port, and what is
written to them at one moment is carried out together.
"""

from __future__ import annotations

import errno
import heapq
import math

from dynamixel_sdk import PortHandler

from hardware.clock import VirtualClock
from hardware.emulator.bus import Bus, Steps, run_in_time_order
from hardware.emulator.wires import buses_of
from hardware.emulator.world import EmulatedRobot


class LoopbackPort(PortHandler):
    """A serial port with an emulated robot at its other end.

    Args:
        world: the robot.
        clock: the host's time; the world's time follows it.
        bus: of the world, the wire of this port; None for the only one.
        wires: what the ports of one robot share; None if there is one.
    """

    def __init__(
        self,
        world: EmulatedRobot,
        clock: VirtualClock,
        bus: Bus | None = None,
        wires: PendingWrites | None = None,
    ) -> None:
        super().__init__(f"loopback:{world.robot.name}")
        self.world, self.clock = world, clock
        self._bus = bus or buses_of(world)[0]
        self._wires = wires or PendingWrites(world)
        self.unplugged = False
        self._arrivals: list[tuple[float, int, bytes]] = []
        self._written = 0
        self._received = bytearray()

    def setupPort(self, cflag_baud: int) -> bool:  # noqa: N802
        """Open the port; the SDK calls this."""
        self._check_cable()
        self.is_open = True
        self.ser = self
        self.tx_time_per_byte = 1000.0 / self.baudrate * 10.0
        return True

    def close(self) -> None:
        """Close the port; the SDK calls this through `ser`."""
        self._received.clear()
        self._arrivals.clear()

    def clearPort(self) -> None:  # noqa: N802
        """Forget what has arrived; what is still on its way is not touched."""
        self._check_cable()
        self._wires.flush_until(before=self.clock.now())
        self._arrive()
        self._received.clear()

    def getBytesAvailable(self) -> int:  # noqa: N802
        """Return how many bytes can be read at once."""
        self._check_cable()
        self._collect()
        return len(self._received)

    def writePort(self, packet: list[int] | bytes) -> int:  # noqa: N802
        """Write bytes to the bus and return how many."""
        self._check_cable()
        now = self.clock.now()
        self._wires.queue(self, now, self._bus.begin(bytes(packet), now, self.baudrate))
        return len(packet)

    def expect(self, arrival: float, data: bytes) -> None:
        """Hand these bytes over at this time [s]."""
        self._written += 1
        heapq.heappush(self._arrivals, (arrival, self._written, data))

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Return up to `length` bytes; if there are none, wait for some or for the timeout."""
        self._check_cable()
        self._collect()
        if not self._received and length > 0:
            end = (self.packet_start_time + self.packet_timeout) / 1000 + 1e-6
            due = self._arrivals[0][0] if self._arrivals else end
            self.clock.sleep_until(min(due, end))
            self._collect()
        data = bytes(self._received[:length])
        del self._received[:length]
        return data

    def getCurrentTime(self) -> float:  # noqa: N802
        """Return the clock's time [ms]."""
        return self.clock.now() * 1000

    def _collect(self) -> None:
        self._wires.flush_until()
        self._arrive()

    def _arrive(self) -> None:
        while self._arrivals and self._arrivals[0][0] <= self.clock.now() + 1e-12:
            self._received += heapq.heappop(self._arrivals)[2]

    def _check_cable(self) -> None:
        """Fail as the operating system does when the adapter was pulled out."""
        if self.unplugged:
            raise OSError(errno.EIO, "Input/output error")


class PendingWrites:
    """Requests that were written to the ports of one robot and are not carried out yet.

    Args:
        world: the robot.
    """

    def __init__(self, world: EmulatedRobot) -> None:
        self._world = world
        self._waiting: list[tuple[LoopbackPort, float, Steps]] = []

    def queue(self, port: LoopbackPort, time: float, steps: Steps) -> None:
        """Take what was written to a port at a time [s], after what was written to it before."""
        if any(other is port for other, _, _ in self._waiting):
            self.flush_until()
        self._waiting.append((port, time, steps))
        if not self._world.robot.buses:
            self.flush_until()

    def flush_until(self, before: float = math.inf) -> None:
        """Carry out what was written before this time [s], all of it together."""
        if not any(time < before for _, time, _ in self._waiting):
            return
        steps_of, self._waiting = self._waiting, []
        for (port, _, _), arrivals in zip(
            steps_of, run_in_time_order(self._world, [s for _, _, s in steps_of]), strict=True
        ):
            for arrival, data in arrivals:
                port.expect(arrival, data)


def loopback_ports(world: EmulatedRobot, clock: VirtualClock) -> list[LoopbackPort]:
    """Return a port for each bus of a robot, in their order."""
    wires = PendingWrites(world)
    return [LoopbackPort(world, clock, bus, wires) for bus in buses_of(world)]
