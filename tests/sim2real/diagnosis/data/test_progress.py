"""Progress neither falls nor stands still."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from sim2real.diagnosis.data.progress import Moving
from sim2real.diagnosis.data.simulate import Simulator, Work
from sim2real.diagnosis.data.together import together
from tests.sim2real.diagnosis import arm


def test_the_share_never_falls_and_stays_below_the_end() -> None:
    """Each simulation moves it a little, however many there are."""
    told: list[tuple[str, float]] = []
    moving = Moving(lambda text, share: told.append((text, share)))
    moving("first", 0.3)
    for _ in range(2000):
        moving.tick()
    moving("second", 0.1)
    shares = [share for _, share in told]
    assert all(one < other for one, other in pairwise(shares[:-1]))
    assert shares[-1] == shares[-2] < 1.0
    assert told[1000][0] == "first"
    moving("done", 1.0)
    moving.tick()
    assert told[-1] == ("done", 1.0)


def test_each_run_of_a_simulator_is_told_here_alone(tmp_path: Path) -> None:
    """What a helping process does is not told by it as well."""
    told: list[float] = []
    moving = Moving(lambda text, share: told.append(share))
    data = arm.data_of(arm.make_log(("coulomb_friction", {"where": "a"}, 0.1)), tmp_path)
    simulator = Simulator(data, threads=2, work=Work(moving.tick))

    def run() -> int:
        simulator.run((), np.zeros(1, int), np.zeros((1, 0)))
        return len(told)

    run()
    assert len(told) == 1
    assert max(together([run] * 6, hands=2)) <= 7
