"""Torque is off, or who may have it was told, whatever happens and whenever; rows are kept."""

import numpy as np
import pytest

from hardware.backends import ServoBackend
from tests.hardware import fault_matrix as matrix

CELLS = pytest.mark.parametrize("fault", matrix.FAULTS, ids=lambda fault: fault.name)
ALLOWED = {
    "": {"off"},
    "one": {"off, servo named", "off"},
    "all": {"off", "on: reported, and again by the next program"},
}


@CELLS
@pytest.mark.parametrize("phase", matrix.PHASES)
def test_in_virtual_time(tmp_path, fault, phase):
    """Each cell, over the emulated bus; as the table of docs/explanation/safety.md says."""
    outcome = matrix.in_virtual_time(fault, phase, tmp_path)
    cell = outcome.cell(fault)
    assert outcome.struck
    assert cell in ALLOWED[fault.leaves], f"{cell}\n{outcome.said}"
    assert cell == documented()[fault.name][list(matrix.PHASES).index(phase)]


@pytest.mark.slow
@CELLS
@pytest.mark.parametrize("phase", matrix.PHASES)
def test_over_a_pty(tmp_path, fault, phase):
    """Each cell in real time, with signals and a port that really goes away."""
    outcome = matrix.over_a_pty(fault, phase, tmp_path)
    cell = outcome.cell(fault)
    assert cell in ALLOWED[fault.leaves], f"{cell}\n{outcome.said}"


def documented() -> dict[str, list[str]]:
    """Return the cells of the table in the documentation, by fault."""
    text = (
        matrix.PAGE.read_text(encoding="utf-8").partition(matrix.BEGIN)[2].partition(matrix.END)[0]
    )
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in text.splitlines()]
    return {name: cells for name, *cells in rows}


def test_an_orderly_exit_parks_a_loaded_robot_before_torque_goes_off(tmp_path, monkeypatch):
    """The joints are where the first episode began when torque goes off, not where they were."""
    backend = ServoBackend(matrix.robot(tmp_path), 0.1)
    backend.start(np.zeros(3))
    for _ in range(40):
        backend.command(np.full(3, 0.8))
        backend.wait()
    world, places = backend.world, []
    assert world is not None
    assert world.mechanics.angle.min() > 0.4
    driver = backend.guard.driver
    off = driver.torque_off

    def look(*times: float) -> None:
        places.append(world.mechanics.angle.copy())
        off(*times)

    monkeypatch.setattr(driver, "torque_off", look)
    backend.close()
    assert abs(places[0]).max() < 0.1
    assert not world.firmware.torque_on.any()


def test_nobody_told_is_said_so():
    """The judge of the matrix fails a cell that must not be."""
    from tests.hardware.fault_matrix import Outcome

    left = Outcome(["hinge1"], "", "", 5, 5, True)
    assert "NOBODY WAS TOLD" in left.cell(matrix.Fault("SIGINT", ("SIGINT",)))
    assert "ROWS LOST" in Outcome([], "", "", 4, 5, True).cell(matrix.FAULTS[0])
