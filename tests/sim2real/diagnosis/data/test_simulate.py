"""Models with large meshes: their memory is bounded, whatever is tried of them."""

import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.plant import Plant
from hardware.log import write_log
from sim2real.diagnosis.data import simulate
from sim2real.diagnosis.data.dataset import Data
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.own_log import own_log

LIMIT = 5_000_000_000  # bytes of address space of a diagnosis, which Python's packages share
DIAGNOSE = (
    "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2); "
    "from sim2real.diagnosis.diagnose import diagnose; "
    "print(diagnose(sys.argv[1], sys.argv[2]).verdict)"
)


def write_ball(path: Path, rings: int) -> None:
    """Write a ball of 4 rings² triangles as an STL."""
    up, around = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1)
    points = 0.02 * np.stack(
        [
            np.outer(np.sin(up), np.cos(around)),
            np.outer(np.sin(up), np.sin(around)),
            np.outer(np.cos(up), np.ones_like(around)),
        ],
        axis=-1,
    )
    one, two, three, four = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    faces = np.concatenate([np.stack([one, two, three], -2), np.stack([one, three, four], -2)])
    triangles = faces.reshape(-1, 9)
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("rest", "<u2")])
    rows = np.zeros(len(triangles), kind)
    rows["corners"] = triangles
    path.write_bytes(b" " * 80 + np.uint32(len(rows)).tobytes() + rows.tobytes())


def write_arm(folder: Path, rings: int) -> Path:
    """Write the arm with such balls, which may touch each other, at its links."""
    write_ball(folder / "ball.stl", rings)
    xml = arm.XML.replace("<worldbody>", '<asset><mesh file="ball.stl"/></asset><worldbody>')
    (folder / "arm.xml").write_text(
        xml.replace("</geom>", "")
        .replace(
            'mass="0.2"/>', 'mass="0.2"/><geom type="mesh" mesh="ball" pos="0 0 -.3" mass="0.01"/>'
        )
        .replace(
            'mass="0.3"/>', 'mass="0.3"/><geom type="mesh" mesh="ball" pos="0 0 .2" mass="0.01"/>'
        )
    )
    return folder / "arm.xml"


def test_no_model_outlives_its_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Large ones and those of effects that act between steps are gone without a collection."""
    made: list[weakref.ref[Plant]] = []

    class Counted(Plant):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            made.append(weakref.ref(self))

    monkeypatch.setattr(simulate, "Plant", Counted)
    data = Data.of([arm.make_log(seconds=4.0)], write_arm(tmp_path, 20))
    simulator = simulate.Simulator(data, threads=1)
    for name in ("coulomb_friction", "backlash", "joint_compliance", "stribeck_friction"):
        effect = make(name, where=arm.JOINTS[0])
        neutral = Plant(data.specs[0], [effect]).space.neutral
        simulator.run((effect,), np.arange(1), neutral[None])
        assert made
        assert all(one() is None for one in made)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_robot_of_large_meshes_is_diagnosed_in_bounded_memory(tmp_path: Path) -> None:
    """Each model of its meshes takes 50 MB; hundreds are made of it."""
    path = write_arm(tmp_path, 220)
    write_log(tmp_path / "log.csv", own_log(path, 0.5))
    args = [DIAGNOSE, str(tmp_path / "log.csv"), str(path), str(LIMIT)]
    done = subprocess.run([sys.executable, "-c", *args], capture_output=True, text=True)
    assert done.stdout.strip() == "no_gap", done.stderr[-2000:]
