"""The firmware's limit on how fast a servo changes its voltage (PWM Slope of the XL330).

It belongs to the servo's settings, not to what a robot may differ in: no effect of the vocabulary.
A model that states such limits has them in every plant:

    <numeric name="torque_rate.elbow" data="31.4"/>           <!-- N·m/s, of an actuator -->
"""

import mujoco
import numpy as np

from envs.effects.base import Effect
from envs.effects.bound import SubstepRule
from envs.effects.plant_view import PlantView
from envs.errors import TaskError
from envs.params import Parameter
from envs.servo_numbers import TORQUE_RATE, servo_numbers


class _Slope(SubstepRule):
    """Narrows the torque's range around what it was in the substep before."""

    order = 45  # after what weakens the range itself

    def __init__(self, plant: PlantView, steps: np.ndarray) -> None:
        self.plant, self.steps = plant, steps  # (n,) N·m a substep
        self.range = plant.live("actuator_forcerange")  # (N, n, 2)
        self.force = plant.batch.bind("actuator_force")  # (N, n), of the substep before
        self.running = np.zeros((plant.num_rows, 1), dtype=bool)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        self.running[ids] = False

    def before_substep(self, ids: np.ndarray | slice) -> None:
        low, high = self.range[ids, :, 0], self.range[ids, :, 1]
        steps = np.where(self.running[ids], self.steps, np.inf)
        force = np.where(self.running[ids], self.force[ids], 0.0)
        lowest = np.clip(force - steps, low, high)
        self.range[ids, :, 1] = np.clip(force + steps, low, high)
        self.range[ids, :, 0] = lowest
        self.running[ids] = True


class PwmSlope(Effect):
    """A limit on the change of each actuator's torque before back-EMF.

    Args:
        rates: the rate of each actuator [N·m/s]; inf for no limit.
    """

    name = "pwm_slope"
    place = "robot"
    unit = "N·m/s"
    symptom = "steps that begin softly, whatever their size"
    source = "the XL330's manual, PWM Slope (62)"
    experiment = "steps of the goal at two settings of the register"

    def __init__(self, rates: np.ndarray) -> None:
        super().__init__()
        self.rates = rates

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return none: it is a setting."""
        return ()

    def bind(self, plant: PlantView) -> SubstepRule:
        """Narrow the ranges before each substep."""
        return _Slope(plant, self.rates * plant.model.opt.timestep)


def list_stated_slope(model: mujoco.MjModel) -> list[tuple[Effect, tuple[()]]]:
    """Return the limit that a model states of its servos, as a fixed effect, if it states any.

    Raises:
        TaskError: a number that is wrong (see `servo_numbers`), or of an actuator whose force has
            no limit that could be narrowed.
    """
    rates = servo_numbers(model, TORQUE_RATE, np.inf)
    limited = np.isfinite(rates)
    if (free := np.flatnonzero(limited & (model.actuator_forcelimited == 0))).size:
        name = model.actuator(int(free[0])).name
        raise TaskError(
            f'<numeric name="torque_rate.{name}">: the actuator has no forcerange; give it that of '
            "its servo, or remove the element"
        )
    return [(PwmSlope(rates), ())] if limited.any() else []
