"""Split a population's rows over the cores of a machine, or put them on a device.

rows = make_shards(environment, num_rows=256)       # as is fastest on as many cores
population = Population(rows, policy)
"""

import logging

import psutil
import torch

from envs.rows import Rows
from sim2real.learning.environment import EnvironmentFactory
from sim2real.runs.errors import Sim2RealError

LOG = logging.getLogger(__name__)
WIDE = 512  # rows from which two shards are faster than one, on 4, 8 and 16 cores


def layout(num_rows: int, cores: int) -> tuple[int, int]:
    """Return how many shards, and threads of each, step `num_rows` rows fastest on `cores`.

    The shards' Python threads share one interpreter, those of the physics do not. Measured on 4, 8
    and 16 cores (`benchmarks/results/shards.csv`), one or two shards with the cores' threads
    between them are never more than 6 % below the best of all splits, and a shard a core is up to
    seven times slower. On two cores a shard each is the fastest.
    """
    if cores <= 2:
        return min(cores, num_rows), 1
    return (2, cores // 2) if num_rows >= WIDE else (1, cores)


def make_shards(
    environment: EnvironmentFactory,
    num_rows: int,
    shards: int | None = None,
    device: torch.device | str = "cpu",
) -> list[Rows]:
    """Split rows over environments that share the cores; on a device there is one.

    Args:
        environment: makes them.
        num_rows: rows in all.
        shards: environments, with the cores' threads between them; None: as `layout` says.
        device: where rows of `physics=warp` are.

    Raises:
        Sim2RealError: for more shards than rows, or a world that has none.
    """
    if environment.on_device:
        return [environment.rows(num_rows, threads=0, device=device)]
    cores = len(psutil.Process().cpu_affinity()) if psutil.LINUX else psutil.cpu_count() or 1
    chosen, threads = layout(num_rows, cores)
    if shards is not None:
        chosen, threads = shards, max(1, cores // max(1, shards))
    if not 1 <= chosen <= num_rows:
        raise Sim2RealError(f"shards={chosen} must be between 1 and num_rows={num_rows}")
    LOG.info("%d rows in %d shards of %d threads, on %d cores", num_rows, chosen, threads, cores)
    counts = [num_rows // chosen + (i < num_rows % chosen) for i in range(chosen)]
    return [environment.rows(count, threads) for count in counts]
