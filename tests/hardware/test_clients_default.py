"""Clients at their own time limits, over the device file, in every mode that they have.

Elsewhere clients are given more patience than they have, as a busy machine needs. Here each keeps
its limits (34 ms for the maker's SDK, 10 ms for servolab's scan): it gets through on an idle
machine, and is tried several times on a busy one.
"""

import sys
from pathlib import Path

import pytest
import yaml

from tests.hardware.client_python import python_of, run_client
from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.test_main import SO101, emulated

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
CLIENTS = Path(__file__).parent / "clients"
ATTEMPTS = 5
SO101_WORDS = ("robot=so101", f"model={SO101}")


def get_through(emulator: tuple[str, ...], python: str, script: str, *words: str) -> None:
    """Run a client against a new emulated robot, until it gets through to its end."""
    told = ""
    for _ in range(ATTEMPTS):
        with emulated(*emulator) as (device, _process):
            done = run_client([python, str(CLIENTS / script), *words, device])
        if done.returncode == 0:
            return
        told = done.stdout + done.stderr
    raise AssertionError(told)


@pytest.mark.parametrize(
    ("client", "module"), [("sdk", "dynamixel_sdk"), ("rustypot", "rustypot"), ("dxl2", "dxl2")]
)
def test_dynamixel_servos_in_every_mode(client: str, module: str, tmp_path: Path) -> None:
    """Three XL330 in current, velocity, position, extended, current-based and PWM mode."""
    pytest.importorskip(module)
    model, robot = tmp_path / "three.xml", tmp_path / "three.yaml"
    model.write_text(many_benches(3, ""))
    robot.write_text(yaml.safe_dump(bench_data(3, name="three", model=str(model))))
    get_through((f"robot={robot}",), sys.executable, "python_client.py", client)


def test_rustypot_at_feetech_servos() -> None:
    """Positions, a wheel and gains of six STS3215."""
    pytest.importorskip("rustypot")
    get_through(SO101_WORDS, sys.executable, "python_client.py", "sts")


@pytest.mark.parametrize(
    ("package", "script"),
    [("ftservo-python-sdk==2.0.1", "ftservo_client.py"), ("servolab==1.0.0", "servolab_client.py")],
)
def test_feetech_servos_in_every_mode(package: str, script: str) -> None:
    """Position, wheel, PWM and step mode, settings, and registered writes of an SO-101's servos."""
    get_through(SO101_WORDS, python_of(package), script)
