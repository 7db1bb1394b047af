"""Find servos of any ID at any speed.

for found in scan(client):
    print(found)                    # 1000000 bits/s  ID   1  xl330-m288  firmware 52
"""

from collections.abc import Iterator
from typing import NamedTuple

from hardware.bus_client import BusClient
from hardware.errors import SerialPortError
from hardware.handshake import SPEEDS_OF, are_several, pinged, several
from hardware.tables import servo_by_number

ALL_SPEEDS = {"dynamixel": (9600, *SPEEDS_OF["dynamixel"]), "feetech": SPEEDS_OF["feetech"]}


class DetectedServo(NamedTuple):
    """A servo that answered, or several that share an ID."""

    baud: int
    id: int
    number: int  # of its model
    firmware: int
    maker: str = "dynamixel"
    shared: bool = False  # whether several answer

    @property
    def model(self) -> str:
        """The name of its type, or its model number."""
        return servo_by_number(self.number, self.maker) or f"model number {self.number}"

    def __str__(self) -> str:
        line = f"{self.baud:>8} bits/s  ID {self.id:>3}  {self.model}  firmware {self.firmware}"
        return f"{line}: {several(self.id)}" if self.shared else line


def scan(client: BusClient, maker: str = "dynamixel") -> Iterator[DetectedServo]:
    """Yield every servo that answers, speed by speed; the port stays open at the last one.

    Raises:
        SerialPortError: the port is not there, or held by another program.
    """
    refused: SerialPortError | None = None
    opened = False
    for baud in ALL_SPEEDS[maker]:
        try:
            client.open(baud)
        except SerialPortError as error:  # a speed that the port cannot run at, or no port at all
            refused = error
            continue
        opened = True
        for number, (model, firmware) in sorted(client.broadcast_ping().items()):
            shared = len(client.ping(number)) > 1 and are_several(pinged(client, number))
            yield DetectedServo(baud, number, model, firmware, maker, shared)
    if refused is not None and not opened:
        raise refused
