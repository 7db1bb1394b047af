"""servolab at a device, in a Python of its own: python servolab_client.py DEVICE.

It finds the six motors of an emulated SO-101 and uses each of its modes, at its own time limits.
"""

from __future__ import annotations

import sys
import time

import servolab  # type: ignore[import-not-found]


def near(found: float, wanted: float, most: float) -> None:
    """Fail if a value is further than this from what it should be."""
    assert abs(found - wanted) <= most, (found, wanted)


def positions(bus: servolab.Bus) -> None:
    """Moves with limits, of one motor and of several, and the feedback of all."""
    for number in (1, 5):
        bus[number].mode = "position"
        bus[number].torque_enabled = True
    bus[1].move_to(0.3, speed=1.0, acceleration=10.0, wait=True)
    bus.move_to({1: 0.0, 5: 0.4}, speed=1.0, wait=True)
    feedback = bus.read_feedback()
    near(feedback.position[0], 0.0, 0.03)
    near(feedback.position[4], 0.4, 0.03)
    assert feedback.ids == [1, 2, 3, 4, 5, 6]


def velocity(bus: servolab.Bus) -> None:
    """The wrist turns at a speed to either side."""
    wrist = bus[5]
    wrist.mode = "velocity"
    for speed in (1.0, -1.0):
        wrist.velocity = speed
        time.sleep(0.4)
        near(wrist.velocity, speed, 0.25)
    wrist.velocity = 0.0
    time.sleep(0.4)
    near(wrist.velocity, 0.0, 0.03)


def pwm(bus: servolab.Bus) -> None:
    """A duty above zero turns towards larger angles."""
    wrist = bus[5]
    wrist.mode = "pwm"
    begin = wrist.position
    wrist.pwm = 0.3
    time.sleep(0.3)
    assert wrist.velocity > 1.0
    wrist.pwm = 0.0
    assert wrist.position > begin + 0.2
    wrist.torque_enabled = False


def settings(bus: servolab.Bus) -> None:
    """A zero, an ID, and the factory's settings, which keep both."""
    pan = bus[1]
    bus.move_to({1: 0.2}, speed=1.0, wait=True)
    time.sleep(0.5)
    pan.set_zero()
    near(pan.position, 0.0, 0.01)
    pan.pid = (20, 0, 32)
    pan.id = 11
    pan.factory_reset()
    assert (pan.id, pan.pid) == (11, (32, 0, 32))
    near(pan.position, 0.0, 0.01)
    assert pan.info["model"] == "STS3215"


def main(device: str) -> None:
    """Run everything; an error is a traceback."""
    bus = servolab.connect(device)
    assert sorted(bus.motors) == [1, 2, 3, 4, 5, 6]
    for step in (positions, velocity, pwm, settings):
        step(bus)
    bus.disconnect()


if __name__ == "__main__":
    main(sys.argv[1])
