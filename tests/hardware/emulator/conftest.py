"""Hosts of emulated servos."""

import pytest

from hardware.config import load_robot
from hardware.emulator.world import EmulatedRobot
from tests.hardware.emulator.host import Host


@pytest.fixture
def host() -> Host:
    """Return a host of bench1."""
    return Host(EmulatedRobot(load_robot("bench1")))


@pytest.fixture
def three(chain) -> Host:
    """Return a host of three servos."""
    return Host(EmulatedRobot(chain(3)))


@pytest.fixture
def floating(chain) -> Host:
    """Return a host of one servo without gravity."""
    return Host(EmulatedRobot(chain(1, option='gravity="0 0 0"')))
