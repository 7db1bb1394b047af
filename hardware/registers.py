"""Registers of one servo by name, read until answered and written until read back.

    write_register(client, servo, "position_p_gain", 800)
    read_register(client, servo, "homing_offset")                   # 0

Names are the manual's, in lower case with underscores (`hardware/tables.py`).
"""

from hardware.bus_client import BusClient
from hardware.config import Servo
from hardware.errors import ServoError

RETRIES = 3


def read_register(client: BusClient, servo: Servo, name: str) -> int:
    """Read a register.

    Raises:
        ServoError: the servo does not answer.
    """
    register = servo.type.register(name)
    for _ in range(RETRIES):
        reply = client.read(servo.id, register.address, register.size)
        if reply is not None and not reply.error:
            return register.decode(reply.data)
    raise ServoError(f"{servo.name} (ID {servo.id}) does not answer a read of {name}")


def write_register(client: BusClient, servo: Servo, name: str, value: int) -> None:
    """Write a register and read it back.

    Raises:
        ServoError: the servo does not answer, refuses, or keeps another value.
    """
    register = servo.type.register(name)
    data = register.encode(value)
    for _ in range(RETRIES):
        reply = client.write(servo.id, register.address, data)
        if reply is not None and reply.error:
            raise ServoError(
                f"{servo.name} (ID {servo.id}) refuses {name} = {value} (error {reply.error}); "
                "EEPROM can only be written with torque off, and values have ranges"
            )
        if read_register(client, servo, name) == register.decode(data):
            return
    raise ServoError(f"{servo.name} (ID {servo.id}): {name} could not be set to {value}")
