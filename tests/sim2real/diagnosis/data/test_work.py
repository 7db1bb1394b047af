"""What is simulated is counted by stage."""

from collections import Counter
from pathlib import Path

import numpy as np

from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.work import OTHER, Work
from tests.sim2real.diagnosis import arm


def test_steps_are_counted_for_the_stage_that_is_going_on() -> None:
    """A stage within another one has both names; what is done apart counts once it is joined."""
    work = Work()
    work.add(1.0, 1)
    with work.during("looking back"):
        with work.during("race"):
            work.add(1.0, 10)
            told, done = work.apart(lambda: work.add(0.5, 5) or "done")
        work.add(1.0, 100)
    assert told == "done" and done == (0.5, {"looking back: race": 5})
    assert work.total == 111 and work.seconds == 3.0
    work.join(done)
    assert work.steps == Counter({OTHER: 1, "looking back: race": 15, "looking back": 100})


def test_a_simulator_and_those_it_makes_count_together(tmp_path: Path) -> None:
    """Steps in longer time steps are part of the same diagnosis."""
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    longer = data.stepping(2 * arm.STEP)
    assert longer is not None
    simulator, every = Simulator(data, threads=1), np.arange(len(data.windows))
    coarse, none = simulator.of(longer), np.zeros((len(data.windows), 0))
    with simulator.work.during("fine"):
        simulator.run((), every, none)
    with simulator.work.during("coarse"):
        coarse.run((), every, none)
    steps = simulator.work.steps
    assert 0.4 * steps["fine"] < steps["coarse"] < 0.6 * steps["fine"]
    assert coarse.steps == simulator.steps == steps["fine"] + steps["coarse"]
