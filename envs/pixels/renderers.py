"""The renderers by name: one switch between rays and OpenGL."""

from typing import Literal

from envs.errors import TaskError, refuse_unknown
from envs.pixels.base import Renderer
from envs.pixels.gl import GLRenderer
from envs.pixels.rays import RayRenderer
from envs.simulation import Simulation

RENDERERS: dict[str, type[Renderer]] = {"rays": RayRenderer, "gl": GLRenderer}
Kind = Literal["rays", "gl"]


def make_renderer(
    kind: Kind, simulation: Simulation, size: int, camera: str | None = None
) -> Renderer:
    """Return a renderer of the simulation's rows.

    Raises:
        TaskError: an unknown kind, a size out of range, or a camera that the model lacks.
        RenderError: `gl` on a machine where nothing can be drawn.
    """
    refuse_unknown("renderer", kind, RENDERERS, TaskError)
    return RENDERERS[kind](simulation, size, camera)
