"""The ripple of a motor's torque with its angle."""

from collections.abc import Mapping

import numpy as np

from envs.effects.base import BOTH, RULES, Effect, Extra, Sizes
from envs.effects.bound import SubstepRule
from envs.effects.extras import phase
from envs.effects.places import block, joints
from envs.effects.plant_view import PlantView
from envs.effects.scale import RobotScale


class _Cogging(SubstepRule):
    """See `Cogging`."""

    order = 60

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self.effect, self.qpos, self.applied = effect, plant.layout.raw_qpos, plant.applied
        self.arrays, self.sin = plant.arrays, plant.arrays.xp.sin
        found = joints(plant.model, effect.where)
        self.q, self.v = plant.model.jnt_qposadr[found], plant.model.jnt_dofadr[found]
        self.value, self.count, self.phase = (np.zeros((plant.num_rows, 1)) for _ in range(3))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, :1]
        self.count[ids, 0] = self.effect.scalar("count", values)
        self.phase[ids, 0] = self.effect.scalar("phase", values)

    def prepare(self, ids: np.ndarray | slice) -> None:
        own, index = self.arrays.own, self.arrays.index
        self.at, self.to = index(block(ids, self.q)), index(block(ids, self.v))
        self.wave = own(self.value[ids]), own(self.count[ids]), own(self.phase[ids])

    def before_substep(self, ids: np.ndarray | slice) -> None:
        value, count, phase = self.wave
        self.applied[self.to] += value * self.sin(count * self.qpos[self.at] + phase)


class Cogging(Effect):
    """A torque ripple over the motor's angle: value sin(count q + phase)."""

    name = "cogging"
    place = "joint"
    engines = BOTH
    unit = "N·m"
    extras = (
        Extra(
            "count",
            "1/turn",
            12.0,
            0.0,
            1e4,
            "ripples per turn of the joint",
            fit=(3.0, 1e4),  # fewer are a swell that no motor makes
            typical=(4.0, 32.0),
        ),
        phase("the ripple's phase at q = 0"),
    )
    typical = (0.0, 0.05)
    no_mjcf = "MJCF has no torque that depends on the position in this way"
    sizes = Sizes("add", "stall", 2e-3, 0.2)
    symptom = "an error that repeats with the position, whatever the speed and direction"
    source = "tau = A sin(N q + phase); MuJoCo XML reference, dcmotor/cogging"
    experiment = "a slow ramp over the whole range, there and back"
    limits = (0.0, np.inf)
    group = RULES
    law = _Cogging

    def probes(self, scale: RobotScale) -> np.ndarray:
        """Return rough ones: the error of a replay shows better ones."""
        size = 0.05 * scale.torque_at(self.where)
        return np.array([(size, 12.0, phase) for phase in np.arange(4) * np.pi / 2])

    @classmethod
    def draw_extras(cls, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Draw a whole number of ripples, and a phase."""
        return {"count": float(rng.integers(6, 31)), "phase": float(rng.uniform(-3, 3))}
