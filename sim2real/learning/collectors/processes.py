"""TorchRL's collector of several processes: each steps some of the rows and acts there.

    collector = ProcessCollector(env, actor, workers=2, frames_per_batch=2048)
    batch = next(iter(collector))                     # a TensorDict (N, T), as Collector yields it

The networks of all processes run at the same time. That can only pay where acting takes as long as
stepping, as with images; measure it before you choose it. The processes begin their episodes and
draw their actions from separate seeds, so that a seed gets the same batches again, but others
than in one process.
"""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.collectors import MultiSyncCollector
from torchrl.envs import EnvBase

from sim2real.learning.environment import EnvironmentFactory, SerializableEnv
from sim2real.learning.trained import drop_per_row_state
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.stopping import holding_interrupts


class ProcessCollector(MultiSyncCollector):
    """`MultiSyncCollector` over the rows of one environment.

    Args:
        create_env_fn: the environment, of N rows; each process makes its share of them anew.
        policy: a tensordict module; the processes follow its parameters.
        workers: W, processes; divides N.
        options: those of `MultiSyncCollector`.

    Raises:
        Sim2RealError: rows that cannot be shared out, or transforms that keep statistics or belong
            to the policy, of which each process would have its own.
    """

    def __init__(
        self, create_env_fn: SerializableEnv, policy: Any, *, workers: int, **options: Any
    ) -> None:
        env, rows = create_env_fn, create_env_fn.batch_size[0]
        if workers < 1 or rows % workers:
            raise Sim2RealError(
                f"collector.workers={workers} does not divide algorithm.num_rows={rows}"
            )
        if env.made.on_device:
            raise Sim2RealError(
                "collector=processes steps its rows on the CPU, not with physics=warp; use "
                "collector=fast or collector=sync"
            )
        chain: Any = env.transform
        if drop_per_row_state(chain.state_dict()) or len(chain) > len(env.made.transforms):
            names = ", ".join(type(one).__name__ for one in chain)
            raise Sim2RealError(
                "collector=processes does not accept transforms that keep statistics or belong to "
                f"a policy, because each process would have its own; used here: {names}; "
                "use collector=sync"
            )
        seeds = np.random.SeedSequence(env.seed).generate_state(workers).tolist()
        share = rows // workers
        made = [partial(_share, env.made, share, int(seed) % 2**31) for seed in seeds]
        try:
            with holding_interrupts():  # Ctrl-C is the main process's, which ends these
                super().__init__(
                    made, policy, cat_results="stack", update_at_each_batch=True, **options
                )
        except KeyboardInterrupt:
            self.shutdown()
            raise

    def iterator(self) -> Iterator[TensorDictBase]:
        """Yield batches (N, T), the processes' rows one below the other."""
        for batch in super().iterator():
            whole: Any = batch.flatten(0, 1)
            whole.refine_names(..., "time")
            yield whole


def _share(environment: EnvironmentFactory, rows: int, seed: int) -> EnvBase:
    """Make the rows of this process, one thread for their physics and one for the policy."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    return environment.make(rows, threads=1, seed=seed)
