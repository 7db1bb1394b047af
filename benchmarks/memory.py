"""Bytes that one more simulation costs, for each way to have many in a process.

    measure()       # {"batched": 9000.0, "gymnasium": 1.1e6, ...}

It runs in a process of its own, in which nothing is freed in between: memory that an earlier row
gave back would otherwise be taken for free.
"""

import multiprocessing
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from benchmarks.load import own_memory


def measure() -> dict[str, float]:
    """Return bytes a simulation by kind; empty where the system does not tell."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_measure)


def _measure() -> dict[str, float]:
    kinds: dict[str, tuple[int, Callable[[int], object]]] = {
        "batched": (1024, _batched),
        "gymnasium": (64, _gymnasium),
    }
    if find_spec("envpool"):
        kinds["envpool"] = (256, _envpool)
    found: dict[str, float] = {}
    kept = [make(1) for _, make in kinds.values()]  # imports and what is made once
    for name, (count, make) in kinds.items():
        before = own_memory()
        kept.append(make(count))
        after = own_memory()
        if before is not None and after is not None:
            found[name] = (after - before) / count
    return found


def _batched(count: int) -> object:
    from benchmarks.rows.batched import make_env
    from benchmarks.world import make_simulation

    env = make_env(make_simulation(count))
    return env, env.rollout(3, break_when_any_done=False)[:, -1].clone()


def _gymnasium(count: int) -> object:
    import gymnasium

    env = gymnasium.make_vec("Hopper-v5", count, vectorization_mode="sync")
    env.reset(seed=0)
    env.step(np.zeros((count, 3)))
    return env


def _envpool(count: int) -> object:
    import envpool

    env = envpool.make("Hopper-v5", env_type="gymnasium", num_envs=count, num_threads=1)
    env.reset()
    env.step(np.zeros((count, 3)))
    return env
