"""LeRobot drives the emulated bus from an environment of its own, which this test makes.

LeRobot's pins exclude ours (dynamixel-sdk below 3.9, an older torch), so it cannot live beside this
project. LEROBOT_PYTHON names the Python of an environment that has it already.
"""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hardware.calibration import apply_calibration, read_calibration
from hardware.config import load_robot
from hardware.connect import make_driver
from tests.hardware.client_python import python_of, run_client
from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.rig import in_real_time
from tests.hardware.test_main import SO101, emulated

CLIENT = Path(__file__).parent / "clients" / "lerobot_client.py"
WANTED = "lerobot[dynamixel,feetech]==0.4.4"
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


@pytest.fixture(scope="module")
def lerobot() -> str:
    """Return the Python of LeRobot's environment."""
    named = os.environ.get("LEROBOT_PYTHON")
    if named:
        return named
    return python_of(WANTED)


def run(python: str, kind: str, device: str) -> str:
    """Run the client, which must succeed; return the last line that it prints."""
    done = run_client([python, str(CLIENT), kind, device])
    assert done.returncode == 0, done.stdout + done.stderr
    return (done.stdout.strip().splitlines() or [""])[-1]


def test_dynamixel_servos(lerobot: str, tmp_path: Path) -> None:
    """It gives a servo its ID, finds all by name, reads and writes one and many, moves them."""
    model, robot = tmp_path / "three.xml", tmp_path / "three.yaml"
    model.write_text(many_benches(3, ""))
    robot.write_text(yaml.safe_dump(bench_data(3, name="three", model=str(model))))
    with emulated(f"robot={robot}") as (device, _):
        run(lerobot, "dynamixel", device)


def test_an_so101_that_lerobot_calibrated(lerobot: str, tmp_path: Path) -> None:
    """The angles that LeRobot tells of the arm are those that our driver reads under its file."""
    with emulated("robot=so101", f"model={SO101}") as (device, _):
        told = json.loads(run(lerobot, "feetech", device))
        path = tmp_path / "so101.json"
        path.write_text(json.dumps(told["calibration"]))
        robot = apply_calibration(load_robot("so101", SO101), read_calibration(path))
        found: list[np.ndarray] = []

        def read() -> None:
            driver = make_driver(replace(robot, port=device))
            try:
                driver.connect()
                found.append(driver.read().position)
            finally:
                driver.close()

        in_real_time(read)
    angles = [told["angles"][name] for name in robot.names]
    assert np.degrees(found[-1]) == pytest.approx(angles, abs=0.5)
    assert 25 < np.degrees(found[-1])[robot.names.index("elbow_flex")] < 35
