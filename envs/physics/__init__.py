"""Engines that step the simulations of a plant: `batch` on the CPU, `warp` on a GPU.

    physics = make_physics("warp", batch, device="cuda")      # of a mujoco.batch.Batch
    physics.step(None, nstep=4)

See `envs.physics.base` for what both offer.
"""

from typing import Any

from mujoco.batch import Batch

from envs.errors import TaskError, did_you_mean
from envs.physics.base import ENGINES, Engine, Physics
from envs.physics.batch import BatchPhysics

__all__ = ["ENGINES", "Engine", "Physics", "make_physics"]


def make_physics(engine: Engine, batch: Batch, device: Any = "cpu") -> Physics:
    """Return the engine of that name over the simulations of a batch.

    Args:
        engine: `batch` or `warp`.
        batch: the simulations; it holds their parameters and starts whatever steps them.
        device: where `warp` steps them: `cpu`, `cuda` or `cuda:1`.

    Raises:
        TaskError: an unknown engine, one that is not installed, or a model that it cannot step.
    """
    if engine == "batch":
        return BatchPhysics(batch)
    if engine == "warp":
        from envs.physics.warp import WarpPhysics

        return WarpPhysics(batch, device)
    raise TaskError(
        f"physics={engine!r} is unknown{did_you_mean(str(engine), ENGINES)};"
        f" choose one of: {', '.join(ENGINES)}"
    )
