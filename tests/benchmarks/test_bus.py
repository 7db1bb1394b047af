"""The cost of a step over the bus: all ways do what they are said to do."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.bus import WAYS, chain, compare, driver, main


@pytest.mark.parametrize("way", list(WAYS)[1:])
def test_each_way_moves_the_servos(way: str, tmp_path: Path) -> None:
    """Goals arrive, whoever sends them."""
    robot = chain(2, tmp_path)
    made = driver(robot)
    step = WAYS[way](robot, made)
    for _ in range(30):
        made.clock.sleep_until(made.clock.now() + 0.02)
        step(np.array([0.2, -0.1]))
    angles = made.read().position
    made.torque_off()
    made.close()
    np.testing.assert_allclose(angles, [0.2, -0.1], atol=0.05)


@pytest.mark.slow
def test_the_table_has_every_way(tmp_path: Path) -> None:
    """A row for each robot, a cost for each way."""
    table = compare([1, 2], 20)
    assert [row[0] for row in table.rows] == [1, 2]
    assert all(min(map(float, map(str, row[1:]))) > 0.0 for row in table.rows)
    assert main(["--servos", "1", "--steps", "5", "--results", str(tmp_path)]) == 0
    assert "driver" in (tmp_path / "bus.md").read_text()
    with pytest.raises(SystemExit):
        main(["--servos", "0"])
