"""Films of a policy, drawn off-screen: before and after adaptation, side by side.

    video = Video(width=320, height=240, fps=25, seconds=10.0)
    path = video.record(algorithm, seed=0, folder=out / "videos")           # a robot that it draws
    path = video.record(algorithm, 0, out / "videos", {"the median gain": values})

Drawing needs a system library, EGL or OSMesa. Without any, `RenderError` says what to install.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
import torchrl  # noqa: F401 - must be imported before any GL context exists, else the process dies
from PIL import Image, ImageDraw, ImageFont
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import EnvBase
from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp

from envs.errors import RenderError
from envs.params import Parameter
from envs.pixels.library import library
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.population.population import draw_seeds
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.video import Camera, write_mp4

VIDEO_STREAM = 3  # which of the seed's streams the film's task and luck are
SIGNS = {"set": "=", "add": "+", "scale": "×"}  # what a parameter does to the model's own value
MARGIN = 22  # px, height of a line of text
SHORTEST = 5.0  # s that each robot is seen at least, if need be in its last picture
LIMITS = {"width": (16, 4096), "height": (16, 4096), "fps": (1, 240), "seconds": (0.1, 3600.0)}


@dataclass(frozen=True)
class Clip:
    """One filmed episode."""

    title: str  # what is seen
    frames: np.ndarray  # pictures at a constant rate, (n, height, width, 3) uint8
    reward: float  # undiscounted return of the whole episode, filmed or not


@torch.no_grad()
def record_clip(
    env: EnvBase,
    actor: TensorDictModuleBase,
    values: np.ndarray,
    seed: int,
    title: str,
    video: Video,
    camera: Camera,
) -> Clip:
    """Run one episode of a robot with parameters (P,), and draw it."""
    world: Any = env.base_env
    simulation = world.rows
    model = simulation.plant.batch.get_model(0)
    dt = model.opt.timestep * simulation.task.frame_skip
    frames, total, steps, over = [], 0.0, 0, False
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        now = env.reset(values=values[None], seeds=np.array([seed], np.uint64))
        while not over:
            if int(steps * dt * video.fps) >= len(frames) and steps * dt < video.seconds:
                data = simulation.plant.batch.get_data(0)
                mujoco.mj_forward(model, data)
                frames.append(camera.draw(model, data))
            after = env.step(actor(now))
            now, over = step_mdp(after), bool(after["next", "done"])
            total, steps = total + float(after["next", "reward"]), steps + 1
    return Clip(title, np.stack(frames), total)


def tile_clips(clips: list[Clip], caption: str, least: int = 1) -> np.ndarray:
    """Put clips side by side under their titles, with a caption below: (n, height, width, 3) uint8.

    A clip that ends early, or before `least` pictures, keeps its last one. Height and width are
    even, as video codecs want them.
    """
    count = max(least, *(len(clip.frames) for clip in clips))
    rows = [clip.frames[np.minimum(np.arange(count), len(clip.frames) - 1)] for clip in clips]
    pictures = np.concatenate(rows, axis=2)  # (n, h, W, 3)
    height, width = pictures.shape[1:3]
    canvas = Image.new("RGB", (width + width % 2, height + 2 * MARGIN + height % 2), "white")
    pen, font = ImageDraw.Draw(canvas), ImageFont.load_default(13)
    for i, clip in enumerate(clips):
        place = (i * width // len(clips) + 6, 3)
        pen.text(place, f"{clip.title}: return {clip.reward:.0f}", fill="black", font=font)
    pen.text((6, MARGIN + height + 3), caption, fill="black", font=font)
    frames = np.tile(np.asarray(canvas), (count, 1, 1, 1))
    frames[:, MARGIN : MARGIN + height, :width] = pictures
    return frames


@dataclass(frozen=True)
class Video:
    """A film of a trained policy.

    Raises:
        Sim2RealError: a size, rate or length that no film has.
    """

    width: int  # the width of one clip [px]
    height: int  # the height of one clip [px]
    fps: int  # pictures per second
    seconds: float  # what is shown of an episode [s]

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            if not low <= getattr(self, name) <= high:
                raise Sim2RealError(
                    f"video.{name}={getattr(self, name)} must be between {low} and {high}"
                )

    def record(
        self,
        algorithm: Algorithm,
        seed: int,
        folder: Path,
        robots: Mapping[str, np.ndarray] | None = None,
    ) -> Path:
        """Film the policy on robots, one after the other; if it adapts, before and after.

        An adaptation that kept the trained policy, such as a climb whose proposals were all worse,
        is called unchanged. Both are filmed with the same random numbers. Each robot is seen for at
        least five seconds, unless the film is shorter.

        Args:
            algorithm: the trained policy.
            seed: draws all random numbers, other than those of training.
            folder: where the film goes.
            robots: their parameters, (P,) each, and what is said of them; None: a robot that the
                seed draws from those of the training.

        Returns:
            The film.

        Raises:
            RenderError: when nothing can be drawn on this machine, or of this environment.
        """
        library()
        environment, trained = algorithm.parts.environment, algorithm.trained()
        if not environment.simulated:
            raise RenderError(
                f"{environment.name} is not a MuJoCo task, so there is nothing to draw"
            )
        env = trained.make_env(1, threads=1)
        rows: Any = env.base_env.rows
        rng = np.random.default_rng([seed, VIDEO_STREAM])
        if robots is None:
            algorithm.parts.tasks.check(rows.space)
            robots = {"": algorithm.parts.tasks.sample(rng, 1)[0]}
        model, parts, adapts = rows.plant.batch.get_model(0), [], False
        least = round(min(SHORTEST, self.seconds) * self.fps)
        with Camera(model, self.width, self.height, rows.task.camera) as camera:
            for said, values in robots.items():
                thetas = {"trained policy": trained.theta}
                adapted = algorithm.adapted(values, rng)
                if adapts := adapted is not None:
                    same = np.array_equal(adapted, trained.theta)
                    spent = f"after {algorithm.parts.adapt.episodes} episodes"
                    after = f"unchanged {spent}" if same else f"{spent} of adaptation"
                    thetas = {"before adaptation": trained.theta, after: adapted}
                luck = int(draw_seeds(rng, 1)[0])
                clips = [
                    record_clip(env, trained.actor(theta), values, luck, name, self, camera)
                    for name, theta in thetas.items()
                ]
                words = ", ".join(format_parameters(rows.space.parameters, values))
                parts.append(tile_clips(clips, f"{said}: {words}" if said else words, least))
        path = folder / ("before_after.mp4" if adapts else "policy.mp4")
        write_mp4(path, np.concatenate(parts), self.fps)
        return path


def format_parameters(parameters: Sequence[Parameter], values: np.ndarray) -> Iterator[str]:
    """Yield parameters (P,) with their values, such as "link mass of torso = 4.5 kg"."""
    for p, value in zip(parameters, values, strict=True):
        name, _, where = p.name.partition(".")
        what = name.replace("_", " ") + (f" of {where}" if where else "")
        yield f"{what} {SIGNS[p.how]} {value:.3g} {p.unit}".rstrip()
