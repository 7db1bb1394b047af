"""What is simulated is counted."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.work import Work
from tests.sim2real.diagnosis import arm

SMALL = 0.2  # of a log's motion, in which no motor reaches its limit


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
