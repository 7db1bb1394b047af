"""Whether two effects make the same equations of motion, so that no recording parts them.

    same_dynamics(spec, (armature, values), (link_inertia, values), settings.causes)
    twins(spec, (armature, values), [link_inertia, ...], settings.causes)    # and their values

A hinge on a fixed base turns alike with more rotor and with more inertia of its link, and a motor
without damping pulls alike with less supply and with less strength. Inertia matrices and forces are
compared in random states under random commands, with the values of the other effect that come
nearest; only of model fields that act through these alone. Limits of force are reached there, since
errors of any size are among them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import least_squares

from envs.plant import Plant
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.settings import Causes

Pair = tuple[Candidate, np.ndarray]  # an effect and its values, (P,)

FIELDS = (  # of bodies, joints and motors: they act through inertia and forces, and nowhere else
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_iquat",
    "dof_armature",
    "actuator_gainprm",
    "actuator_biasprm",
    "actuator_damping",
    "actuator_forcerange",
    "actuator_gear",
)
STATES = 24  # random ones: many more than values of an effect
SPEED = 10.0  # rad/s or m/s: of the order of servos' speeds without load


def same_dynamics(spec: mujoco.MjSpec, one: Pair, other: Pair, limits: Causes) -> bool:
    """Return whether, with some values, another effect moves the robot as one does.

    Args:
        spec: the robot's model.
        one: an effect and its values.
        other: another effect and the values that were fitted to the same logs; one's values are
            tried for it as well, where they are as many.
        limits: how near is the same.
    """
    wanted = _Wanted.of(spec, one)
    apart = wanted and wanted.apart(spec, other[0])
    if not apart:
        return False
    start = apart.nearest(v for v in (other[1], one[1]) if v.shape == other[0].low.shape)
    near = apart.size(start) < limits.twin_near
    return near and apart.size(apart.least(start)) < limits.twin_same


def twins(
    spec: mujoco.MjSpec, one: Pair, others: Iterable[Candidate], limits: Causes
) -> Iterator[Pair]:
    """Yield those of other effects that move the robot as one does, and the values that do so.

    The values are looked for from an effect's probes, however far these are from them.
    """
    wanted = _Wanted.of(spec, one)
    if wanted is None:
        return
    for other in others:
        if apart := wanted.apart(spec, other):
            values = apart.least(apart.nearest(other.probes))
            if apart.size(values) < limits.twin_same:
                yield other, values


@dataclass(frozen=True)
class _Wanted:
    """What an effect with given values makes of a robot's inertia and forces."""

    states: _States
    forces: np.ndarray  # inertia and forces in all states, flat
    change: float  # norm of what the effect changes

    @classmethod
    def of(cls, spec: mujoco.MjSpec, one: Pair) -> _Wanted | None:
        """Return it; None for what changes nothing, or acts through more than these."""
        plant = Plant(spec, [one[0].effect], 1)
        if not _acts_alone(plant):
            return None
        states = _States(plant.nominal)
        forces = states.forces(plant, one[1])
        change = float(np.linalg.norm(forces - states.forces(plant, one[0].neutral)))
        return cls(states, forces, change) if change > 0 else None

    def apart(self, spec: mujoco.MjSpec, other: Candidate) -> _Apart | None:
        """Return how far apart another effect is; None if it acts through more than these."""
        plant = Plant(spec, [other.effect], 1)
        return _Apart(self, plant, other) if _acts_alone(plant) else None


@dataclass(frozen=True)
class _Apart:
    """How far apart an effect with given values and another one move the robot."""

    wanted: _Wanted
    plant: Plant  # with the other effect
    other: Candidate

    def _wrong(self, values: np.ndarray) -> np.ndarray:
        found = self.wanted.states.forces(self.plant, values)
        return (found - self.wanted.forces) / self.wanted.change

    def size(self, values: np.ndarray) -> float:
        """Return the distance with the other's values (P,), of what the first one changes."""
        return float(np.linalg.norm(self._wrong(values)))

    def nearest(self, starts: Iterable[np.ndarray]) -> np.ndarray:
        """Return the nearest of values (P,), within the other's bounds."""
        clipped = [np.clip(start, self.other.low, self.other.high) for start in starts]
        return min(clipped, key=self.size)

    def least(self, start: np.ndarray) -> np.ndarray:
        """Return the values (P,) with which the other comes nearest."""
        bounds = self.other.low, self.other.high
        return least_squares(self._wrong, start, bounds=bounds, x_scale="jac", xtol=1e-12).x


def _acts_alone(plant: Plant) -> bool:
    """Return whether inertia and forces say all that a plant's effect does."""
    varied = [name for name in dir(plant.model) if plant.is_field_written(name)]
    return bool(varied) and not plant.substep_rules and set(varied) <= set(FIELDS)


class _States:
    """Random states and commands of a robot, in which its equations of motion are looked at."""

    def __init__(self, model: mujoco.MjModel) -> None:
        rng = np.random.default_rng(0)
        self._steps = rng.uniform(-np.pi, np.pi, (STATES, model.nv))
        self._speeds = rng.uniform(-SPEED, SPEED, (STATES, model.nv))
        limited = model.actuator_ctrllimited.astype(bool)[:, None]
        ends = np.where(limited, model.actuator_ctrlrange, (-np.pi, np.pi))
        self._ctrl = rng.uniform(ends[:, 0], ends[:, 1], (STATES, model.nu))
        self._act = rng.uniform(-1.0, 1.0, (STATES, model.na))

    def forces(self, plant: Plant, values: np.ndarray) -> np.ndarray:
        """Return the inertia, times a speed's square, and the forces in all states, flat."""
        model = _model(plant, values)
        data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
        mujoco.mj_setConst(model, data)
        rest, found = np.array(model.qpos0), []
        for step, speed, ctrl, act in zip(
            self._steps, self._speeds, self._ctrl, self._act, strict=True
        ):
            data.qpos[:] = rest
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
            data.qvel[:], data.ctrl[:], data.act[:] = speed, ctrl, act
            mujoco.mj_forward(model, data)
            mujoco.mj_fullM(model, data, inertia)
            found += [SPEED**2 * inertia.ravel(), np.array(data.qfrc_smooth)]
        return np.concatenate(found)


def _model(plant: Plant, values: np.ndarray) -> mujoco.MjModel:
    """Return the model that an effect's values (P,) make, with commands that arrive at once."""
    row = np.zeros(1, int)
    plant.set_params(row, values[None])
    model = copy(plant.model)
    for name in FIELDS:
        if plant.is_field_written(name):
            getattr(model, name)[:] = plant.field_values(name, row)[0]
    model.actuator_delay[:] = 0.0
    return model
