"""The interface of a plant to the effects that are bound to it; `envs.plant.Plant` is one.

    class BoundEffect:
        def __init__(self, plant: PlantView) -> None:
            self.friction = plant.field("dof_frictionloss")     # (N, nv), to be written per row

An effect never imports the plant: the plant imports the effects.
"""

from collections.abc import Callable
from typing import Protocol, TypeVar

import mujoco
import numpy as np
from mujoco.batch import Batch

from envs.effects.layout import Layout
from envs.physics.arrays import Array, Arrays
from envs.physics.base import Physics

T = TypeVar("T")


class PlantView(Protocol):
    """N simulations of one robot.

    Attributes:
        nominal: the model as given.
        model: the simulated one, with the joints that effects added.
        batch: its simulations, which hold the parameters and start the episodes.
        physics: what steps them.
        arrays: where its arrays are.
        num_rows: N.
        layout: where the nominal model's state is in the simulated one's.
        ctrl: the commands in force, (N, nu).
        applied: torques and forces that substep rules add, (N, nv of `model`).
        time: the time of each simulation [s], (N,).
    """

    nominal: mujoco.MjModel
    model: mujoco.MjModel
    batch: Batch
    physics: Physics
    arrays: Arrays
    num_rows: int
    layout: Layout
    ctrl: Array
    applied: Array
    time: Array

    def field(self, name: str) -> np.ndarray:
        """Return a model field's values per row, (N, ...), to be written."""
        ...

    def live(self, name: str) -> np.ndarray:
        """Return the same for a substep rule to change; each substep starts as `write` left it."""
        ...

    def now(self, name: str) -> Array:
        """Return a live field in the engine, (N, ...), for rules that are prepared or act."""
        ...

    def shared_mechanism(self, name: str, make: Callable[[], T]) -> T:
        """Return the mechanism of that name, made once for all the effects that are parts of it."""
        ...
