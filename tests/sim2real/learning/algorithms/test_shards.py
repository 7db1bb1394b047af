"""Rows over the cores of a machine."""

from functools import partial

import psutil
import pytest

from envs.mujoco import MujocoEnv
from envs.tasks import Hopper
from sim2real.learning.algorithms.shards import layout, make_shards
from sim2real.learning.environment import EnvironmentFactory


@pytest.mark.parametrize(
    ("num_rows", "cores", "expected"),
    [(64, 1, (1, 1)), (64, 2, (2, 1)), (1, 2, (1, 1)), (64, 16, (1, 16)), (1024, 16, (2, 8))],
)
def test_all_cores_are_used_by_few_shards(num_rows: int, cores: int, expected) -> None:
    """Two cores have a shard each, more share one or two."""
    assert layout(num_rows, cores) == expected


def test_rows_are_split_over_the_shards_that_are_asked_for(caplog) -> None:
    """Every row has a place, the cores' threads are shared out, and the log says how."""
    environment = EnvironmentFactory(partial(MujocoEnv, task=Hopper()))
    with caplog.at_level("INFO", "sim2real.learning.algorithms.shards"):
        shards = make_shards(environment, 7, 3)
    assert [rows.num_rows for rows in shards] == [3, 2, 2]
    cores = len(psutil.Process().cpu_affinity()) if psutil.LINUX else psutil.cpu_count()
    assert f"7 rows in 3 shards of {max(1, cores // 3)} threads, on {cores} cores" in caplog.text
