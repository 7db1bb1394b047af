"""Find a robot's serial port: the one that disappears when its cable is pulled.

find_port(ask_terminal, print)
"""

from collections.abc import Callable, Sequence

from hardware.errors import SerialPortError
from hardware.serial_ports import SerialPort, hints, serial_ports
from hardware.terminal import Ask, Tell

NO_PORT = (
    "no serial port is there: plug the adapter in; if it is, look at the last lines of dmesg, and "
    "hand it on to a container or a virtual machine"
)


def find_port(
    ask: Ask, tell: Tell, look: Callable[[], Sequence[SerialPort]] = serial_ports
) -> str | None:
    """List the ports and what to do for each; ask for the cable to be pulled if several are on USB.

    Args:
        ask: asks the person; at no terminal the list is all there is.
        tell: shows a line.
        look: lists the ports.

    Returns:
        The port, or None if it cannot be said.

    Raises:
        SerialPortError: there is no port, or none or several went with the cable.
    """
    before = look()
    for port in before:
        tell(str(port))
        for hint in hints(port):
            tell(f"    {hint}")
    if not before:
        raise SerialPortError(NO_PORT)
    there = [port for port in before if port.vendor is not None] or before
    if len(there) > 1:
        try:
            ask("pull the robot's USB cable, then press Enter ")
        except EOFError:
            return None
        left = {port.device for port in look()}
        there = [port for port in before if port.device not in left]
        if len(there) != 1:
            raise SerialPortError(f"{len(there)} ports disappeared with the cable; try again")
        tell("plug it in again")
    tell(f"the robot is at {there[0].device}: give port={there[0].device}")
    return there[0].device
