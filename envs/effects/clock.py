"""A log's clock that runs at another rate than the robot's time."""

import numpy as np

from envs.effects.base import BOTH, PLAIN, Effect
from envs.effects.bound import BoundEffect
from envs.effects.plant_view import PlantView


class _Rate(BoundEffect):
    """See `ClockDrift`."""

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._step, self._own = plant.field("opt.timestep"), plant.model.opt.timestep

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        rate = values[:, 0].reshape(-1, *[1] * (self._step.ndim - 1))
        self._step[ids] = self._own / (1.0 + rate)


class ClockDrift(Effect):
    """Fraction by which the log's clock runs fast: log time = true time * (1 + value).

    It scales the time step, so effects with a state, such as lags, follow the log's clock.
    """

    name = "clock_drift"
    engines = BOTH
    place = "robot"
    unit = ""
    typical = (-0.03, 0.03)
    no_mjcf = "it is the log's, not the robot's"
    symptom = "swings and ramps that are all too long or too short by the same fraction"
    source = "t_log = (1 + d) t; quartz: 1e-5 to 1e-4, RC oscillators: up to 1e-1"
    experiment = "a free swing of known period, or readings with time stamps from another clock"
    first_values = (-0.03, -0.008, 0.008, 0.03)
    group = PLAIN
    limits = (-0.1, 0.1)
    law = _Rate
