"""Films of a policy, drawn off-screen: before and after adaptation, side by side.

    video = Video(width=320, height=240, fps=25, seconds=10.0)
    path = video.record(algorithm, env, seed=0, folder=out / "videos")

Drawing needs a system library, EGL or OSMesa. Without any, `RenderError` says what to install.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import torch
import torchrl  # noqa: F401 - must be imported before any GL context exists, else the process dies
from PIL import Image, ImageDraw, ImageFont

from envs.errors import RenderError
from envs.pixels.library import library
from envs.rows import Rows
from envs.simulation import Simulation
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.algorithms.esmaml import ESMAML, make_shards
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.learning.population.population import Members, Population, draw_seeds
from sim2real.runs.film import Camera, write_mp4

Act = Callable[[np.ndarray], np.ndarray]  # raw observation (O,) to action (A,)
VIDEO_STREAM = 3  # which of the seed's streams the film's task and luck are
SIGNS = {"set": "=", "add": "+", "scale": "×"}  # what a parameter does to the model's own value
MARGIN = 22  # px, height of a line of text


@dataclass(frozen=True)
class Clip:
    """One filmed episode.

    Attributes:
        title: what is seen.
        frames: pictures at a constant rate, (n, height, width, 3) uint8.
        reward: undiscounted return of the whole episode, filmed or not.
    """

    title: str
    frames: np.ndarray
    reward: float


def film(
    simulation: Simulation,
    act: Act,
    values: np.ndarray,
    seed: int,
    title: str,
    video: Video,
    camera: Camera,
) -> Clip:
    """Run one episode in row 0 and draw it.

    Args:
        simulation: where; its row 0 is used.
        act: the policy.
        values: the robot's parameters, (P,).
        seed: of the episode.
        title: of the clip.
        video: rate and length.
        camera: what draws.
    """
    row, plant = np.zeros(1, np.int64), simulation.plant
    observation = simulation.reset(row, values[None], np.array([seed], np.uint64))
    model = plant.batch.get_model(0)
    dt = model.opt.timestep * simulation.task.frame_skip
    frames, total, steps, over = [], 0.0, 0, False
    while not over:
        if int(steps * dt * video.fps) >= len(frames) and steps * dt < video.seconds:
            data = plant.batch.get_data(0)
            mujoco.mj_forward(model, data)
            frames.append(camera.draw(model, data))
        step = simulation.step(row, act(observation[0])[None])
        observation, over = step.observation, bool(step.terminated[0] or step.truncated[0])
        total, steps = total + float(step.reward[0]), steps + 1
    return Clip(title, np.stack(frames), total)


def compose(clips: list[Clip], caption: str) -> np.ndarray:
    """Put clips side by side under their titles, with a caption below.

    A clip that ends early keeps its last picture.

    Returns:
        (n, height, width, 3) uint8, height and width even, as video codecs want them.
    """
    count = max(len(clip.frames) for clip in clips)
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

    Args:
        width: of one clip [px].
        height: of one clip [px].
        fps: pictures per second.
        seconds: what is shown of an episode [s].
    """

    width: int
    height: int
    fps: int
    seconds: float

    def record(
        self, algorithm: Algorithm, env: Callable[..., Rows], seed: int, folder: Path
    ) -> Path:
        """Film the policy on a task that the seed draws; if it adapts, before and after.

        Both are filmed under the same luck.

        Args:
            algorithm: the trained policy.
            env: makes its environment.
            seed: draws the task and all luck, other than that of training.
            folder: where the film goes.

        Returns:
            The film.

        Raises:
            RenderError: when nothing can be drawn on this machine, or of this environment.
        """
        library()
        rng = np.random.default_rng([seed, VIDEO_STREAM])
        tasks = getattr(algorithm, "tasks", None)
        (rows,) = make_shards(env, 1, 1, tasks.effects if tasks else ())
        if not isinstance(rows, Simulation):
            raise RenderError(f"{type(rows).__name__} is no MuJoCo task, there is nothing to draw")
        values = tasks.sample(rng, 1)[0] if tasks else rows.space.neutral
        acts = _policies(algorithm, rows, values, rng)
        luck = int(draw_seeds(rng, 1)[0])
        model = rows.plant.batch.get_model(0)
        with Camera(model, self.width, self.height, rows.task.camera) as camera:
            clips = [
                film(rows, act, values, luck, name, self, camera) for name, act in acts.items()
            ]
        named = zip(rows.space.parameters, values, strict=True)
        words = [f"{p.name} {SIGNS[p.how]} {value:.3g} {p.unit}".rstrip() for p, value in named]
        frames = compose(clips, ", ".join(words))
        path = folder / ("before_after.mp4" if len(clips) > 1 else "policy.mp4")
        write_mp4(path, frames, self.fps)
        return path


def _policies(
    algorithm: Algorithm, rows: Simulation, values: np.ndarray, rng: np.random.Generator
) -> dict[str, Act]:
    """Return the policies to film by title: the trained one, and what it adapts to on this task."""
    if not isinstance(algorithm, ESMAML) or isinstance(algorithm.adapt, NoAdaptation):
        return {"trained policy": _act(algorithm.module())}
    adapt, theta = algorithm.adapt, algorithm.theta
    cohort = adapt.start_many(theta[None], [rng])
    seeds = draw_seeds(rng, (1, adapt.episodes))
    members = Members(cohort, values[None], values[None], seeds)
    adapted = Population([rows], algorithm.policy).run(members, algorithm.normalizer).thetas[0]
    after = f"after {adapt.episodes} episodes of adaptation"
    return {"before adaptation": _act(algorithm.module()), after: _act(_with(algorithm, adapted))}


def _with(algorithm: ESMAML, theta: np.ndarray) -> torch.nn.Module:
    """Return the algorithm's policy with other parameters."""
    seen = algorithm.normalizer or Normalizer(algorithm.policy.observation_size)
    return algorithm.policy.module(theta, seen.mean, seen.std)


def _act(module: torch.nn.Module) -> Act:
    """Return a torch policy as a function of arrays."""

    def act(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return module(torch.from_numpy(observation)).numpy().astype(np.float64)

    return act
