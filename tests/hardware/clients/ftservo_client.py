"""The maker's SDK at a device, in a Python of its own: python ftservo_client.py DEVICE.

As the examples of ftservo-python-sdk do it drives an emulated SO-101, at the SDK's own time limits.
"""

from __future__ import annotations

import sys
import time
from importlib import import_module
from typing import Any

sdk: Any = import_module("scservo_sdk")  # another package of this name may live beside us

ARM = (1, 2, 3, 4, 5, 6)


def near(found: float, wanted: float, most: float) -> None:
    """Fail if a value is further than this from what it should be."""
    assert abs(found - wanted) <= most, (found, wanted)


def good(answer: tuple[Any, ...]) -> Any:
    """Return what an answer holds, which must have come, and without an error."""
    *values, result, error = answer
    assert (result, error) == (sdk.COMM_SUCCESS, 0), answer
    return values[0] if values else None


def position(servos: Any) -> None:
    """Single, registered and group writes of positions, and group reads."""
    for number in ARM:
        assert good(servos.ping(number)) == 777
        good(servos.write1ByteTxRx(number, 40, 1))
    good(servos.WritePosEx(1, 2300, 1500, 50))
    time.sleep(1.5)
    near(good(servos.ReadPos(1)), 2300, 25)
    good(servos.RegWritePosEx(1, 2048, 1500, 50))
    time.sleep(0.3)
    near(good(servos.ReadPos(1)), 2300, 25)
    assert servos.RegAction() == sdk.COMM_SUCCESS
    time.sleep(1.5)
    near(good(servos.ReadPos(1)), 2048, 25)
    for number in (1, 5):
        assert servos.SyncWritePosEx(number, 2150, 1500, 50)
    assert servos.groupSyncWrite.txPacket() == sdk.COMM_SUCCESS
    servos.groupSyncWrite.clearParam()
    time.sleep(1.5)
    group = sdk.GroupSyncRead(servos, 56, 4)
    for number in (1, 5):
        assert group.addParam(number)
    assert group.txRxPacket() == sdk.COMM_SUCCESS
    for number in (1, 5):
        near(group.getData(number, 56, 2), 2150, 25)


def wheel(servos: Any) -> None:
    """The wrist turns as a wheel to either side, and stops."""
    good(servos.WheelMode(5))
    for speed in (800, -800):
        good(servos.WriteSpec(5, speed, 50))
        time.sleep(0.5)
        near(good(servos.ReadSpeed(5)), speed, 150)
    good(servos.WriteSpec(5, 0, 50))
    time.sleep(0.5)
    near(good(servos.ReadSpeed(5)), 0, 20)
    good(servos.write1ByteTxRx(5, 40, 0))
    good(servos.write1ByteTxRx(5, 33, 0))


def duty_and_steps(servos: Any) -> None:
    """The wrist turns by duty, and by counts from where it is."""
    good(servos.write1ByteTxRx(5, 33, 2))
    good(servos.write1ByteTxRx(5, 40, 1))
    good(servos.write2ByteTxRx(5, 44, servos.scs_toscs(-300, 10)))
    time.sleep(0.3)
    assert good(servos.ReadSpeed(5)) > 600
    good(servos.write2ByteTxRx(5, 44, 0))
    time.sleep(0.5)
    good(servos.write1ByteTxRx(5, 33, 3))
    begin = good(servos.ReadPos(5))
    good(servos.write2ByteTxRx(5, 42, servos.scs_toscs(-200, 15)))
    time.sleep(1.0)
    near(good(servos.ReadPos(5)), begin - 200, 25)
    good(servos.write1ByteTxRx(5, 40, 0))
    good(servos.write1ByteTxRx(5, 33, 0))


def setting_up(servos: Any) -> None:
    """The middle is where it is now; another ID is kept behind the lock."""
    good(servos.write1ByteTxRx(5, 40, 128))
    near(good(servos.ReadPos(5)), 2048, 1)
    good(servos.unLockEprom(6))
    good(servos.write1ByteTxRx(6, 5, 16))
    good(servos.LockEprom(16))
    assert good(servos.ping(16)) == 777


def main(device: str) -> None:
    """Run everything; an error is a traceback."""
    port = sdk.PortHandler(device)
    servos = sdk.sms_sts(port)
    assert port.openPort() and port.setBaudRate(1_000_000)
    for step in (position, wheel, duty_and_steps, setting_up):
        step(servos)
    for number in (1, 2, 3, 4, 5, 16):
        good(servos.write1ByteTxRx(number, 40, 0))
    port.closePort()


if __name__ == "__main__":
    main(sys.argv[1])
