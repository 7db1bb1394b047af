"""An encoder whose disc or magnet is off its axis."""

from typing import Any

import numpy as np

from envs.effects.base import BOTH, RULES, Effect
from envs.effects.bound import Measurement, SubstepRule
from envs.effects.extras import phase
from envs.effects.places import block, joints
from envs.effects.plant_view import PlantView
from envs.effects.servo import is_joint_servo
from envs.physics.arrays import Array

STEPS = 4  # of Newton's method, which starts within the amplitude of the answer


class _Eccentric(Measurement):
    """Readings of k eccentric encoders: angle + value sin(angle + phase)."""

    order = 25

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        found = joints(plant.model, effect.where)
        addresses = np.array([plant.layout.address(int(j)) for j in found])
        self.effect, self.arrays, (self.q, self.v) = effect, plant.arrays, addresses.T
        self.value, self.phase = (np.zeros((plant.num_rows, 1)) for _ in range(2))
        self.size, self.start = (self.arrays.zeros((plant.num_rows, 1)) for _ in range(2))
        self.columns = self.arrays.own(self.q), self.arrays.own(self.v)

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self.value[ids] = values[:, :1]
        self.phase[ids, 0] = self.effect.scalar("phase", values)
        rows, own = self.arrays.rows(ids), self.arrays.own
        self.size[rows], self.start[rows] = own(self.value[ids]), own(self.phase[ids])

    def measure(self, ids: Any, qpos: Array, qvel: Array) -> None:
        xp, (q, v) = self.arrays.xp, self.columns
        angle = qpos[:, q] + self.start[ids]
        qpos[:, q] += self.size[ids] * xp.sin(angle)
        qvel[:, v] *= 1.0 + self.size[ids] * xp.cos(angle)

    def measure_path(self, dt: float, qpos: np.ndarray, qvel: np.ndarray) -> None:
        angle = qpos[:, :, self.q] + self.phase[:, None]
        qpos[:, :, self.q] += self.value[:, None] * np.sin(angle)

    def unmeasure(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> None:
        value, phase = self.value[ids], self.phase[ids]
        said = qpos[:, self.q]
        angle = said.copy()
        for _ in range(STEPS):
            rest = angle + value * np.sin(angle + phase) - said
            angle -= rest / (1.0 + value * np.cos(angle + phase))
        qpos[:, self.q] = angle


class _Loop(SubstepRule):
    """Closes servo loops over what their encoders say."""

    order = 22  # after a play on the link's side

    def __init__(self, plant: PlantView, encoder: _Eccentric, servos: np.ndarray) -> None:
        model = plant.model
        self.plant, self.encoder, self.servos = plant, encoder, servos
        joint, self.xp = model.actuator_trnid[servos, 0], plant.arrays.xp
        self.gear = plant.arrays.own(model.actuator_gear[servos, 0])
        self.q, self.v = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
        plant.live("actuator_biasprm")

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep the rows whose encoders are off their axes, and how far."""
        rows = np.arange(self.plant.num_rows)[ids]
        rows = rows[self.encoder.value[rows, 0] != 0]
        own, index = self.plant.arrays.own, self.plant.arrays.index
        self.bias = self.plant.now("actuator_biasprm")
        self.at, self.rows = index(block(rows, self.servos)), rows
        self.size, self.phase = own(self.encoder.value[rows]), own(self.encoder.phase[rows])
        self.places = index(block(rows, self.q)), index(block(rows, self.v))

    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Shift the laws by what the encoders say too much."""
        if not self.rows.size:
            return
        layout, (q, v) = self.plant.layout, self.places
        angle = layout.raw_qpos[q] + self.phase
        speed = self.size * self.xp.cos(angle) * layout.raw_qvel[v]
        stiff, drag = self.bias[(*self.at, 1)], self.bias[(*self.at, 2)]  # (n, k)
        shift = stiff * self.size * self.xp.sin(angle) + drag * speed
        self.bias[(*self.at, 0)] += self.gear * shift


class EncoderEccentricity(Effect):
    """An encoder off its axis, with one error wave per turn: measured = q + value sin(q + phase).

    The servo controls the same reading. Over a small range of motion the error looks like an
    offset and a slope.
    """

    name = "encoder_eccentricity"
    place = "joint"
    engines = BOTH
    unit = "rad"
    extras = (phase("the error's phase at q = 0"),)
    typical = (0.0, 0.05)
    no_mjcf = "MJCF has no encoder whose error depends on the angle"
    symptom = "an error that repeats once a turn, the same in both directions and at any speed"
    source = "e sin(q + phase), e = offset over radius; ams AS5600 data sheet: up to 1 degree"
    experiment = "one slow turn there and back, against a second encoder or marks on the housing"
    limits = (0.0, 0.9)
    first_values = tuple((0.02, phase) for phase in (0.0, np.pi, np.pi / 2, -np.pi / 2))
    group = RULES

    def bind(self, plant: PlantView) -> Measurement:
        """Change what is read, and what the joint's servos see."""
        model, found = plant.model, joints(plant.model, self.where)
        encoder = _Eccentric(plant, self)
        servos = [i for i in range(model.nactuator) if is_joint_servo(model, i)]
        servos = np.array([i for i in servos if model.actuator_trnid[i, 0] in found], int)
        if servos.size:
            plant.shared_mechanism(
                f"servo of {self.label()}", lambda: _Loop(plant, encoder, servos)
            )
        return encoder
