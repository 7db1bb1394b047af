"""Hopper: one leg that is rewarded for moving forward and staying upright.

`Hopper` is Gymnasium's Hopper-v5. `HopperPolito` is the 500-step template of the sim-to-real
studies: velocities are not clipped, the step on which it falls is paid too, and the source robot's
torso is one kilogram lighter.
"""

from typing import ClassVar, Literal

import mujoco

from envs.errors import TaskError, refuse_unknown
from envs.physics.arrays import Array
from envs.tasks.base import GymnasiumTask, State, forward_velocity


class Hopper(GymnasiumTask):
    """Gymnasium 1.4 Hopper-v5: observation (11,), action (3,) torques in [-1, 1] times 200 N·m.

    Args:
        max_steps: control steps an episode (8 ms each).
    """

    array_api = True
    asset = "hopper.xml"
    frame_skip = 4
    camera = "track"
    reset_noise = 5e-3
    healthy_height = 0.7  # m, of the torso
    healthy_angle = 0.2  # rad, of the torso
    healthy_state = 100.0  # largest magnitude of any other state
    velocity_clip: ClassVar[float | None] = 10.0
    control_cost = 1e-3

    def observe(self, state: State) -> Array:
        """Return (height, angles, velocities) without the horizontal position, (n, 11)."""
        qvel = (
            state.qvel
            if self.velocity_clip is None
            else self.xp.clip(state.qvel, -self.velocity_clip, self.velocity_clip)
        )
        return self.xp.concat([state.qpos[:, 1:], qvel], axis=1)

    def terminated(self, state: State) -> Array:
        """Return whether the hopper fell or left the healthy range, (n,)."""
        xp, q = self.xp, state.qpos
        upright = (q[:, 1] > self.healthy_height) & (xp.abs(q[:, 2]) < self.healthy_angle)
        sane = xp.all(xp.abs(q[:, 2:]) < self.healthy_state, axis=1) & xp.all(
            xp.abs(state.qvel) < self.healthy_state, axis=1
        )
        return ~(upright & sane)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return forward velocity + 1 while healthy - control cost, (n,)."""
        velocity = forward_velocity(before.qpos, after.qpos, self.dt)
        return velocity + ~terminated - self.control_cost * self.effort(action)


POLITO_MASSES = {  # kg, of the target; legacy is what mujoco-py computed for the same capsules
    "legacy": {"torso": 3.53429174, "thigh": 3.92699082, "leg": 2.71433605, "foot": 5.0893801},
    "native": {},
}


class HopperPolito(Hopper):
    """The 500-step Hopper of the transfer studies.

    Args:
        domain: "source" (torso 1 kg lighter) or "target".
        masses: "legacy" (those of the old engine) or "native" (what this engine computes from the
            shapes).
        max_steps: control steps an episode.
    """

    velocity_clip = None

    def __init__(
        self,
        domain: Literal["source", "target"] = "source",
        masses: Literal["legacy", "native"] = "native",
        max_steps: int = 500,
    ) -> None:
        super().__init__(max_steps)
        refuse_unknown("domain", domain, ("source", "target"), TaskError)
        refuse_unknown("masses", masses, POLITO_MASSES, TaskError)
        self.domain, self.masses = domain, masses

    def spec(self) -> mujoco.MjSpec:
        """Return the Hopper with the study's masses."""
        spec = super().spec()
        model = spec.compile()
        spec.compiler.inertiafromgeom = (
            mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        )  # else masses are ignored
        for body in ("torso", "thigh", "leg", "foot"):
            mass = POLITO_MASSES[self.masses].get(body, float(model.body(body).mass[0]))
            if body == "torso" and self.domain == "source":
                mass -= 1.0
            _set_mass(spec, model, body, mass)
        return spec

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return forward velocity + 1 - control cost, (n,); the falling step is paid too."""
        return super().reward(before, after, action, self.xp.zeros_like(terminated))


def _set_mass(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, mass: float) -> None:
    """Give a body an explicit mass and keep its inertia tensor, as writing body_mass does."""
    body, compiled = spec.body(name), model.body(name)
    body.explicitinertial = True
    body.mass, body.ipos, body.iquat, body.inertia = (
        mass,
        compiled.ipos,
        compiled.iquat,
        compiled.inertia,
    )
