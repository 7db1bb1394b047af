"""Ant: four legs in three dimensions, rewarded for moving along x and staying off the ground."""

from typing import Literal, get_args

from envs.errors import TaskError, refuse_unknown
from envs.physics.arrays import Array
from envs.tasks.base import GymnasiumTask, State

Forces = Literal["off", "exact"]


class Ant(GymnasiumTask):
    """Gymnasium 1.4 Ant-v5: action (8,) torques in [-1, 1] times 150 N·m.

    The engine's batch does not compute the contact forces that Gymnasium shows the ant and charges
    for. "off" leaves them out, as Gymnasium does with include_cfrc_ext_in_observation=False and
    contact_cost_weight=0: observation (27,). "exact" computes them row by row, several times
    slower: observation (105,), equal to Gymnasium's default.

    Args:
        contact_forces: "off" or "exact".
        max_steps: control steps an episode (50 ms each).

    Raises:
        TaskError: another value of contact_forces.
    """

    array_api = True
    asset = "ant.xml"
    frame_skip = 5
    camera = "track"
    extra_field = (
        "xpos"  # Gymnasium's velocity comes from the torso's position, one substep behind qpos
    )
    reset_noise = 0.1
    velocity_noise = "normal"
    torso = 1  # body
    healthy_height = (0.2, 1.0)  # m, of the torso
    control_cost = 0.5
    contact_cost = 5e-4
    contact_clip = 1.0  # N and N·m

    def __init__(self, contact_forces: Forces = "off", max_steps: int = 1000) -> None:
        refuse_unknown("contact_forces", contact_forces, get_args(Forces), TaskError)
        self.contact_forces = contact_forces == "exact"
        super().__init__(max_steps)

    def observe(self, state: State) -> Array:
        """Return (height, orientation, angles, velocities[, clipped forces]), (n, 27 or 105)."""
        seen = [state.qpos[:, 2:], state.qvel]
        if state.forces is not None:
            seen.append(
                self._clipped(state.forces)[:, 1:].reshape(len(state.qpos), -1)
            )  # without the world
        return self.xp.concat(seen, axis=1)

    def terminated(self, state: State) -> Array:
        """Return whether the torso is too low or too high, or the state is not finite, (n,)."""
        low, high = self.healthy_height
        height = state.qpos[:, 2]
        return ~(self.finite(state) & (low <= height) & (height <= high))

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return forward velocity + 1 while healthy - control cost [- contact cost], (n,)."""
        velocity = self.velocity(before, after)
        cost = self.control_cost * self.effort(action)
        if after.forces is not None:
            cost = cost + self.contact_cost * self.effort(
                self._clipped(after.forces).reshape(len(action), -1)
            )
        return velocity + ~terminated - cost

    def velocity(self, before: State, after: State) -> Array:
        """Return the torso's velocity along x, (n,) [m/s]."""
        if before.extra is None or after.extra is None:
            raise TaskError(
                "Ant's reward needs the bodies' positions: give State.extra = xpos, (n, bodies, 3)"
            )
        return (after.extra[:, self.torso, 0] - before.extra[:, self.torso, 0]) / self.dt

    def _clipped(self, forces: Array) -> Array:
        return self.xp.clip(forces, -self.contact_clip, self.contact_clip)  # (n, bodies, 6)
