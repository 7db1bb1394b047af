"""The interface of an engine that steps a plant's simulations.

A `mujoco.batch.Batch` of the same rows always holds the parameters and starts the episodes, in
float64: effects write its expanded fields, `set_const` follows, and a reset computes the state from
which the row goes on. An engine that steps elsewhere is notified which rows were written or
started, and takes them over. So effects that write fields, structural ones included, and the
randomness of starts are the same on every engine, to its precision.

    physics.written(ids)            # parameters of the rows ids changed in the batch
    physics.started(ids)            # and their states
    physics.step(None, nstep=4)
    broken = physics.broken(None)
"""

from typing import Any, Literal, Protocol, get_args

import numpy as np

from envs.physics.arrays import Array, Arrays

Engine = Literal["batch", "warp"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


class Physics(Protocol):
    """Steps N simulations of one model.

    Attributes:
        name: of the engine.
        arrays: where its arrays are.
    """

    name: Engine
    arrays: Arrays

    def bind(self, name: str) -> Array:
        """Return a live array (N, ...) over a field of MjData.

        State fields may be written; the others are one substep behind the state after a step.
        """
        ...

    def field(self, name: str, own: np.ndarray) -> Array:
        """Return a live array (N, ...) over a field of the model that has a value per row.

        Known once parameters were written.

        Args:
            name: of the field.
            own: the batch's values, (N, ...).
        """
        ...

    def written(self, ids: np.ndarray) -> None:
        """Take over the model's fields of the rows ids (n,) from the batch."""
        ...

    def started(self, ids: np.ndarray) -> None:
        """Take over the state of the rows ids (n,) from the batch, and what was bound."""
        ...

    def step(self, ids: np.ndarray | None, nstep: int) -> None:
        """Advance the rows ids (None: all) by nstep substeps; the others stay as they are."""
        ...

    def broken(self, rows: Any) -> Array:
        """Return which of the rows broke in the steps since the last look, (n,) bool.

        A broken row's state is not finite, beyond what the engine takes, or was replaced by it.

        Args:
            rows: an index into the engine's arrays (see `Arrays.rows`).
        """
        ...
