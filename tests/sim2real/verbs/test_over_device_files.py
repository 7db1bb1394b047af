"""The verbs at device files, in real time, beside programs that are not ours."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hardware.errors import HardwareError
from hardware.log import read_log, read_logs
from tests.hardware.test_main import emulated, patiently
from tests.sim2real.trained import run_verb, train

SO101 = str(Path(__file__).parents[2] / "hardware" / "so101.xml")
HIDDEN = """
- {effect: command_delay, where: null, value: 0.025}
- {effect: coulomb_friction, where: elbow_flex, value: 0.3}
"""
ARM = ["robot=so101", f"robot.model={SO101}", "arm=true"]
FOLLOW = ["env=follow", f"env.task.model={SO101}", "env.task.seconds=2.0", "algorithm=ppo"]
FOLLOW += ["iterations=2", "algorithm.num_rows=8", "algorithm.steps=32"]
QUAD8 = ["env=quad8", "env.task.seconds=1.0", "policy=mlp", "iterations=1"]
QUAD8 += ["algorithm.num_rows=4", "algorithm.shards=1", "algorithm.pairs=2"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]


def go(out: Path, *words: str) -> Any:
    """Run a verb as the command line does."""
    return run_verb(list(words), out)


def again(folder: Path, action: Callable[[Path], Any]) -> Any:
    """Do what needs real time, again if a busy machine was said to be too slow, or stopped it."""
    for attempt in range(6):
        try:
            return action(folder / str(attempt))
        except HardwareError as error:
            said = str(error)
    raise AssertionError(said)


def feetech(device: str) -> list[tuple[int, int]]:
    """Return (position, torque enable) of six servos, as the maker's own SDK reads them."""
    sdk = pytest.importorskip("scservo_sdk")
    port, packets = sdk.PortHandler(device), sdk.PacketHandler(0)
    assert port.openPort() and port.setBaudRate(1_000_000)
    found = []

    for number in range(1, 7):
        assert patiently(packets.read2ByteTxRx, port, number, 3)[0] == 777
        position = patiently(packets.read2ByteTxRx, port, number, 56)[0]
        found.append((position, patiently(packets.read1ByteTxRx, port, number, 40)[0]))
    port.closePort()
    return found


def test_an_so101_is_recorded_diagnosed_and_driven(tmp_path):
    """A hidden delay of 25 ms, no whole row, and friction are named; a policy runs there.

    The maker's SDK reads the bus before and after, and finds every servo without torque.
    """
    hidden = tmp_path / "hidden.yaml"
    hidden.write_text(HIDDEN)
    with emulated("robot=so101", f"model={SO101}", f"hidden={hidden}") as (device, _):
        assert feetech(device) == [(2048, 0)] * 6
        at = [*ARM, f"port={device}"]
        motions = "motions=[ramp,chirp,steps]"

        def record(out: Path) -> Path:
            go(out, "run=record", *at, motions, "seconds=20")
            return out / "log.csv"

        log = again(tmp_path / "record", record)
        after = feetech(device)
        assert [torque for _, torque in after] == [0] * 6
        assert max(abs(position - 2048) for position, _ in after) > 100
        assert np.ptp(read_log(log).column("qpos.elbow_flex")) > 0.3
        run = train(tmp_path / "train", FOLLOW)

        def deploy(out: Path) -> Any:
            stops = "stops={stray: 2.0}"
            return go(out, "run=deploy", f"checkpoint={run}", *at, "trials=1", "settle=0.5", stops)

        done = again(tmp_path / "deploy", deploy)
        assert len(done.before) == 1
        assert [torque for _, torque in feetech(device)] == [0] * 6
    go(tmp_path / "diagnose", "run=diagnose", f"log={log}")
    report = json.loads((tmp_path / "diagnose" / "report.json").read_text())
    causes = {  # what these motions cannot tell apart counts as named
        (one["effect"], one["where"]): cause["value"]
        for cause in report["causes"]
        for one in (cause, *cause["equivalent"])
    }
    assert report["verdict"] in ("explained", "partly_explained")
    assert causes["command_delay", None] == pytest.approx(0.025, abs=0.003)
    assert causes["coulomb_friction", "elbow_flex"] == pytest.approx(0.3, abs=0.06)


def second_device(process: subprocess.Popen[str]) -> str:
    """Return the device of the line that an emulator prints next."""
    assert process.stdout is not None
    return process.stdout.readline().split(" at ")[1].split(",")[0]


def test_a_quad8_walks_with_its_imu_at_a_port(tmp_path):
    """No Python of one's own: servos at one device, the IMU at another, its columns in the log."""
    run = train(tmp_path / "train", QUAD8)
    with emulated("robot=quad8") as (device, process):
        at = [f"port={device}", f"imu_port={second_device(process)}", "robot=quad8", "arm=true"]

        def deploy(out: Path) -> Path:
            words = ["run=deploy", f"checkpoint={run}", "trials=1", "settle=0.5"]
            go(out, *words, "stops={stray: 2.0}", *at)
            return out

        out = again(tmp_path / "deploy", deploy)
    (log,) = read_logs(out / "logs")
    quaternion = np.stack([log.column(f"quat.imu.{part}") for part in "wxyz"], axis=1)
    assert np.linalg.norm(quaternion, axis=1) == pytest.approx(1, abs=1e-6)
    assert np.ptp(quaternion, axis=0).max() > 1e-3
    felt = np.stack([log.column(f"accelerometer.imu.{part}") for part in "xyz"], axis=1)
    assert np.median(np.linalg.norm(felt, axis=1)) == pytest.approx(9.81, abs=2)
    assert "gyro.imu.x" not in log.columns  # the part's frames have none
    assert log.column("sensor.imu_lost_0")[-1] < 0.2 * 100 * log.time[-1]
