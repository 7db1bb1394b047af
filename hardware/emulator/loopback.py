"""The emulated bus as a port of dynamixel-sdk, in this process and in virtual time.

    port = LoopbackPort(World(load_robot("bench1")), VirtualClock())
    port.openPort()
    PacketHandler(2.0).ping(port, 1)        # the SDK's own code over the emulator's bytes

Waiting for bytes moves the clock to their arrival, or to the end of the packet's timeout. Nothing
depends on how fast this machine is.
"""

from __future__ import annotations

import errno
import heapq

from dynamixel_sdk import PortHandler

from hardware.clock import VirtualClock
from hardware.emulator.wires import bus_of
from hardware.emulator.world import World


class LoopbackPort(PortHandler):
    """A serial port with an emulated robot at its other end.

    Args:
        world: the robot.
        clock: the host's time; the world's time follows it.
    """

    def __init__(self, world: World, clock: VirtualClock) -> None:
        super().__init__(f"loopback:{world.robot.name}")
        self.world, self.clock = world, clock
        self._bus = bus_of(world)
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
        self._collect()
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
        for arrival, data in self._bus.feed(bytes(packet), now, self.baudrate):
            self._written += 1
            heapq.heappush(self._arrivals, (arrival, self._written, data))
        return len(packet)

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
        while self._arrivals and self._arrivals[0][0] <= self.clock.now() + 1e-12:
            self._received += heapq.heappop(self._arrivals)[2]

    def _check_cable(self) -> None:
        """Fail as the operating system does when the adapter was pulled out."""
        if self.unplugged:
            raise OSError(errno.EIO, "Input/output error")
