"""What is simulated is counted."""

from pathlib import Path

import numpy as np

from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.work import Work
from tests.sim2real.diagnosis import arm


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
