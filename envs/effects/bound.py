"""An effect bound to a plant: values of fields, rules between steps, readings.

In one control step a plant calls its bound effects in this order, within a kind by their `order`,
then as given:

1. `CommandRule`: what arrives of the command (packet loss), once a control step;
2. `SubstepRule`: before each physics substep (goal profiles 10, servo feedback 20, dead zone 30,
   supply 40, friction 50, applied torques 60); the command's delay is the engine's own and follows;
3. `Measurement`: what the sensors say afterwards (side of a play 10, sampling delay 20, encoder
   offset 30, noise 40, quantization 50, speed filter 60).
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np


class BoundEffect:
    """An effect connected to one plant, which calls it; each method does nothing by default.

    `write`, `reset` and `on_episode_start` get NumPy's arrays. What `command`, `before_substep` and
    `measure` get is the engine's (`PlantView.arrays`): an effect whose class names another engine
    than the batch computes there in the Array API.
    """

    order: ClassVar[int] = 100  # among the bound effects of its kind, small first
    memory: str = ""  # which of `Effect.memory` it keeps; "": none

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        """Put the values (n, k) of the effect's k parameters into the rows ids.

        The plant restores the model's own values of the fields it gave out (`Plant.field`) before
        it calls this, so that effects on one field compose: each adds to or scales what the ones
        before it left.
        """

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        """Forget what the rows ids remember; their state is set, nothing is measured yet."""

    def misremember(self, ids: np.ndarray) -> None:
        """Let its memory in the rows ids (n,) be off by one standard deviation, after a reset.

        The deviation is that of what a log leaves unknown at the start of a window.
        """

    def on_episode_start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        """Take note of the commands (n, nu) held from before the episodes in the rows ids."""


class CommandRule(BoundEffect, ABC):
    """A bound effect that changes what arrives of the command, once a control step."""

    @abstractmethod
    def command(self, ids: np.ndarray | slice, ctrl: np.ndarray) -> None:
        """Change the commands ctrl (n, nu) of the rows ids in place."""


class SubstepRule(BoundEffect, ABC):
    """A bound effect that acts before each physics substep, on all the rows of a call at once.

    Rows in which all of its parameters are neutral are left out: what it remembers stands still
    there. A mechanism that several effects share acts on every row.

    It changes controls (`plant.ctrl`), model fields (`Plant.live`, restored before each substep) or
    adds to the applied forces (`Plant.applied`, zeroed before each substep).
    """

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Take note of the rows that the coming calls of `before_substep` are for.

        Called before the first of them, and again whenever the rows or their parameters are
        others: the place for what stays the same from substep to substep.
        """

    @abstractmethod
    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Act on the rows ids, through the plant's batch (controls, applied forces)."""


class Measurement(BoundEffect, ABC):
    """A bound effect that changes what the robot's sensors say, not what the robot does."""

    needs_speed: ClassVar[bool] = False  # whether `measure_path` must be given speeds

    @abstractmethod
    def measure(self, ids: np.ndarray | slice, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Change the measured qpos (n, nq) [rad, m] and qvel (n, nv) of the rows ids in place.

        Called once after each reset and each control step: a measurement may remember the ones
        before.
        """

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Change what is measured along whole paths in place, as `measure` would step by step.

        A measurement that defines it can be replayed in one call of the engine.

        Args:
            dt: s between physics steps.
            qpos: what the encoders see at each of them, (N, K + 1, nq), of all rows.
            qvel: its speed, (N, K + 1, nv); empty where no measurement `needs_speed`.
        """
        raise NotImplementedError

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Turn measured qpos (n, nq) and qvel (n, nv) into true ones in place, as far as known."""
