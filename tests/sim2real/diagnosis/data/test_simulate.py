"""Simulation of windows: its memory is bounded, whatever the meshes; what is done is counted."""

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
from sim2real.diagnosis.data.simulate import Simulator, Work
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.own_log import own_log

SMALL = 0.2  # of a log's motion, in which no motor reaches its limit
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


def test_what_is_done_apart_counts_once_it_is_added() -> None:
    """A helper's steps come back with what it was asked for."""
    work = Work()
    work.add(1.0, 10)
    told, done = work.apart(lambda: work.add(0.5, 5) or "done")
    assert told == "done" and done == (0.5, 5)
    assert (work.seconds, work.steps) == (1.0, 10)
    work.add(*done)
    assert (work.seconds, work.steps) == (1.5, 15)


def test_a_simulator_and_those_it_makes_count_together(tmp_path: Path) -> None:
    """Steps in longer time steps are part of the same diagnosis."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    longer = data.stepping(2 * arm.STEP)
    assert longer is not None
    simulator, every = Simulator(data, threads=1), np.arange(len(data.windows))
    coarse, none = simulator.of(longer), np.zeros((len(data.windows), 0))
    simulator.run((), every, none)
    fine = simulator.work.steps
    coarse.run((), every, none)
    assert coarse.work is simulator.work
    assert 1.4 * fine < simulator.work.steps < 1.6 * fine


@pytest.mark.parametrize("own", [0.0, 0.003])
def test_longer_steps_delay_a_command_by_as_much(tmp_path: Path, own: float) -> None:
    """A delay of less than a longer step changes the motion as it does in the model's own steps."""
    log, xml = arm.make_log(seconds=4.0), arm.XML
    for name in arm.JOINTS:
        for column in (f"ctrl.{name}", f"qpos.{name}"):
            log.columns[column][:] *= SMALL
        there = f'joint="{name}" kp'
        xml = xml.replace(there, f'joint="{name}" delay="{own}" nsample="3" kp')
    (tmp_path / "late.xml").write_text(xml, encoding="utf-8")
    data, changes = Data.of([log], str(tmp_path / "late.xml")), []
    longer = data.stepping(5 * arm.STEP)
    assert longer is not None
    for one in (data, longer):
        simulator, every = Simulator(one, threads=1), np.arange(len(one.windows))
        given = simulator.run((), every, np.zeros((len(every), 0))).error
        late = simulator.run((make("command_delay"),), every, np.full((len(every), 1), 0.006)).error
        changes.append((late - given)[one.mask])
    fine, coarse = changes
    assert np.square(coarse - fine).sum() < 0.3**2 * np.square(fine).sum()
