"""Dry friction as bristles that bend before they slip: what a joint does before it breaks away.

The LuGre model, C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, A new model for control
of systems with friction, IEEE Trans. Automatic Control 40 (3), 1995, equations 1 to 3:

    dz/dt = w - s0 |w| / g(w) z        tau = s0 z + s1 dz/dt

g is the friction of steady sliding, all of the joint's: its own, Coulomb, Stribeck and
load-dependent. The bristles' stiffness s0 is g(0) over the deflection at which they slip, their
damping s1 = 2 r sqrt(s0 J) with a ratio r of critical (0.5 in the paper's table I).

Discretized by one linearly implicit Euler step (Hairer and Wanner, Solving Ordinary Differential
Equations II, IV.7): z' = (z + dt w') / (1 + dt a) with a = s0 |w| / g(w) of the step's start and
the speed w' of its end. The torque is then linear in w', and its slope goes into the joint's
damping, which the engine's `Euler` and `implicit` integrators solve for at the step's end: stable
for any stiffness. Under `RK4`, which does not, bristles stiffer than the step can carry act as the
stiffest that it can.
"""

from __future__ import annotations

import mujoco
import numpy as np

from envs.effects.base import Effect
from envs.effects.bound import SubstepRule
from envs.effects.extras import Extra
from envs.effects.places import Block, block, spaced
from envs.effects.plant_view import PlantView
from envs.physics.arrays import Array

STABLE = 0.25  # largest (dt w)² of bristles under an explicit integration
AT_REST = 1e-3  # rad/s: a joint that starts slower than this is held by its bristles
BRISTLE, RATIO = "bristle", "ratio"
EXTRAS = (  # of an effect whose dry friction can act through bristles
    Extra(
        BRISTLE,
        "rad",
        0.0,
        0.0,
        0.1,
        "elastic displacement of the joint before it breaks away; 0: rigid",
        fit=(0.0, 0.02),
        later=True,
    ),
    Extra(RATIO, "", 0.5, 0.0, 2.0, "damping ratio of the bristles; table I of the LuGre paper"),
)
LEAST = 1e-12  # N·m: a joint without friction has no bristles


class Bristles(SubstepRule):
    """Takes the place of the engine's friction loss in the rows whose bristles bend.

    Args:
        plant: the simulations.
        dofs: of k joints.

    Attributes:
        bend: rad at which the joint breaks away, (N, 1); 0 leaves the engine's rigid friction.
        ratio: of critical damping that the bristles have, (N, 1).
        faded: N·m by which the friction at standstill exceeds that at the present speed, (N, k).
    """

    order = 55  # after all that adds to the friction loss

    def __init__(self, plant: PlantView, dofs: np.ndarray) -> None:
        model, shape = plant.model, (plant.num_rows, len(dofs))
        self._plant, self._arrays, self._xp = plant, plant.arrays, plant.arrays.xp
        self.bend, self.ratio = np.zeros((plant.num_rows, 1)), np.zeros((plant.num_rows, 1))
        self.faded = self._arrays.zeros(shape)
        self._dofs, self._dt, self._applied = dofs, model.opt.timestep, plant.applied
        plant.live("dof_frictionloss")
        plant.live("dof_damping")
        self._qvel, self._smooth = plant.layout.raw_qvel, plant.physics.bind("qfrc_smooth")
        self._inertia = self._arrays.own(model.dof_M0[dofs])
        explicit = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        self._stiffest = STABLE * self._inertia / self._dt**2 if explicit else np.inf
        self._z, self._decay = (self._arrays.zeros(shape) for _ in range(2))  # rad, 1/s
        self._running = self._arrays.zeros(plant.num_rows, bool)

    @classmethod
    def of(cls, plant: PlantView, effect: Effect, dofs: np.ndarray) -> Bristles:
        """Return the bristles of an effect at k joints, made once."""
        return plant.shared_mechanism(f"{effect.label()} bristles", lambda: cls(plant, dofs))

    def take(self, effect: Effect, ids: np.ndarray, values: np.ndarray) -> None:
        """Be as an effect with `EXTRAS` says, under values (n, P) of the rows ids."""
        self.bend[ids, 0] = effect.scalar(BRISTLE, values)
        self.ratio[ids, 0] = effect.scalar(RATIO, values)

    def reset(self, ids: np.ndarray, seeds: np.ndarray) -> None:
        """Let the first substep find what bends the bristles."""
        self._running[self._arrays.rows(ids)] = False

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep the rows whose bristles bend."""
        rows = np.arange(len(self.bend))[ids]
        bent = rows[self.bend[rows, 0] > 0]
        own, index = self._arrays.own, self._arrays.index
        self._some, self._bent = bool(bent.size), index(spaced(bent))
        self._at = index(block(bent, self._dofs))
        self._deep, self._damped = own(self.bend[bent]), own(self.ratio[bent])  # (n, 1)
        self._loss, self._damping = (
            self._plant.now(name) for name in ("dof_frictionloss", "dof_damping")
        )

    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Replace the friction loss of the joints by the bristles' torque."""
        rows, at, dt = self._bent, self._at, self._dt
        if not self._some:
            return
        xp = self._xp
        speed, level = self._qvel[at], xp.maximum(self._loss[at], LEAST)
        stiffness = (level + self.faded[rows]) / self._deep
        stiffness = xp.minimum(stiffness, self._stiffest)
        damping = 2.0 * self._damped * xp.sqrt(stiffness * self._inertia)
        moved = (self._z[rows] + dt * speed) / (1.0 + dt * self._decay[rows])
        z = xp.where(self._running[rows][:, None], moved, self._first(at, speed, stiffness, level))
        decay = stiffness * xp.abs(speed) / level
        slope = (stiffness * dt + damping) / (1.0 + dt * decay)
        self._applied[at] -= (slope - damping) / dt * z
        self._damping[at] += slope
        self._loss[at] = 0.0
        self._z[rows], self._decay[rows], self._running[rows] = z, decay, True

    def _first(self, at: Block, speed: Array, stiffness: Array, level: Array) -> Array:
        """Return how far a start bends the bristles: a joint at rest is held as far as they can."""
        xp = self._xp
        held = xp.minimum(xp.maximum(self._smooth[at], -level), level)
        return xp.where(xp.abs(speed) < AT_REST, held, xp.sign(speed) * level) / stiffness


def has_bristles(effect: Effect) -> bool:
    """Return whether an effect with `EXTRAS` has bristles that bend, or may have them."""
    return effect.extra[BRISTLE] > 0 or BRISTLE in effect.free
