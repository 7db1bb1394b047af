"""Films: what they show, and what is said where nothing can be drawn."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
import torch
from torch import nn

from envs.effects import make
from envs.errors import RenderError
from envs.mujoco import MujocoEnv
from envs.pixels.library import library
from envs.randomization import Draw, Randomization
from envs.simulation import Simulation
from envs.tasks.hopper import Hopper
from envs.toys import Nav2D, NavGoals, ToyEnv
from sim2real.evaluation import videos as video
from sim2real.evaluation.evaluate import Evaluation
from sim2real.evaluation.grid import Axis, Grid
from sim2real.evaluation.scores import GridScores
from sim2real.evaluation.videos import Camera, Clip, Video, record_clip, tile_clips, write_mp4
from sim2real.learning.adapt import HillClimb, NoAdaptation
from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.esmaml import ESMAML, ESMAMLSettings
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.acting import Acting
from sim2real.learning.modules.mlp_policy import mlp_policy

TASKS = Randomization(
    [
        Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0),
        Draw(make("ground_friction"), low=1.5, high=2.5),
    ]
)
ES = {
    "num_rows": 4, "shards": 1, "refill": 1, "pairs": 2, "sigma": 0.1, "learning_rate": 0.1,
    "optimizer": "sgd", "estimator": "antithetic", "shaping": "none", "top_k": 0,
    "orthogonal": False, "weight_decay": 0.0, "paired_tasks": True, "tasks_per_member": 1,
    "final_episodes": 1, "step_cost": 0.0, "normalize_observations": True,
    "meta_estimator": "zeroth_order", "first_order_queries": 2, "clean_final": (),
}  # fmt: skip


def learner(env: Any, tasks: Any, adapt: Any) -> ESMAML:
    """Return an untrained algorithm."""
    shape = {"hidden": (), "activation": "tanh", "output": "tanh", "initial": "normal"}
    parts = Components(EnvironmentFactory(env, tasks), partial(mlp_policy, **shape), 0, adapt)
    return ESMAML(parts, ESMAMLSettings(**ES))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value"), [("width", -1), ("height", 100_000), ("fps", 0), ("seconds", -1.0)]
)
def test_a_film_that_cannot_be_is_refused_when_it_is_made(name: str, value: float) -> None:
    """Before any training: sizes, rate and length have limits."""
    size: dict[str, Any] = {"width": 320, "height": 240, "fps": 25, "seconds": 10.0}
    with pytest.raises(ValueError, match=rf"video\.{name}={value} must be between"):
        Video(**{**size, name: value})


class Still(nn.Module):
    """No torque, whatever is seen."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return zeros for each row."""
        return torch.zeros(len(observation), 3)


@pytest.fixture
def draws() -> None:
    """Skip, with the line that says what to install, where nothing can be drawn."""
    try:
        library()
    except RenderError as error:
        pytest.skip(str(error))


def read(path: Path) -> tuple[dict, np.ndarray]:
    """Return what a film says about itself and its pictures."""
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    width, height = about["size"]
    frames = [np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in reader]
    return about, np.stack(frames)


@pytest.mark.render
@pytest.mark.usefixtures("draws")
def test_before_and_after_are_side_by_side_in_one_film(tmp_path: Path) -> None:
    """A policy that adapts is filmed twice; the film lasts as long as the longer episode."""
    env = partial(MujocoEnv, task=Hopper())
    climb = HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1)
    path = Video(160, 120, 25, 0.4).record(learner(env, TASKS, climb), 0, tmp_path)
    about, frames = read(path)
    assert path.name == "before_after.mp4" and about["size"] == (320, 164) and about["fps"] == 25
    assert 1 <= len(frames) <= 10
    robots = frames[0, 22:142].reshape(120, 2, 160, 3)
    assert robots[:, 0].std() > 20 and robots[:, 1].std() > 20
    assert sorted(p.name for p in tmp_path.iterdir()) == ["before_after.mp4"]


@pytest.mark.render
@pytest.mark.usefixtures("draws")
def test_robots_are_filmed_one_after_the_other(tmp_path: Path, monkeypatch) -> None:
    """Each for five seconds at least, though both fall at once, and under its own words."""
    said: list[str] = []

    def composed(clips: list[Clip], words: str, least: int) -> np.ndarray:
        said.append(words)
        return tile_clips(clips, words, least)

    monkeypatch.setattr(video, "tile_clips", composed)
    env = partial(MujocoEnv, task=Hopper(max_steps=20))
    robots = {"median gain (+3)": np.array([2.0, 1.5]), "large": np.array([9.0, 0.5])}
    climb = HillClimb(mode="sequential", queries=1, parallel=1, sigma=0.1)
    path = Video(64, 64, 10, 6.0).record(learner(env, TASKS, climb), 0, tmp_path, robots)
    about, frames = read(path)
    assert len(frames) == 2 * 50 and about["fps"] == 10
    assert said == [
        "median gain (+3): link mass of torso = 2 kg, ground friction = 1.5",
        "large: link mass of torso = 9 kg, ground friction = 0.5",
    ]
    assert np.abs(frames[0].astype(int) - frames[50]).mean() > 0.5
    short = Video(64, 64, 10, 0.5).record(learner(env, TASKS, climb), 0, tmp_path, robots)
    assert len(read(short)[1]) == 2 * 5


@pytest.mark.render
@pytest.mark.usefixtures("draws")
@pytest.mark.parametrize(
    ("moved", "title"),
    [(0.0, "unchanged after 3 episodes"), (0.1, "after 3 episodes of adaptation")],
)
def test_an_adaptation_that_kept_the_policy_says_so(moved, title, tmp_path, monkeypatch) -> None:
    """Else two clips that are the same look like a film that went wrong."""
    titles: list[str] = []

    def composed(clips: list[Clip], words: str, least: int) -> np.ndarray:
        titles.extend(clip.title for clip in clips)
        return tile_clips(clips, words, least)

    monkeypatch.setattr(video, "tile_clips", composed)
    climb = HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1)
    algorithm = learner(partial(MujocoEnv, task=Hopper(max_steps=20)), TASKS, climb)
    theta = algorithm.trained().theta + moved
    monkeypatch.setattr(algorithm, "adapted", lambda values, rng: theta)
    Video(64, 64, 10, 0.1).record(algorithm, 0, tmp_path)
    assert titles == ["before adaptation", title]


def test_the_robots_that_tell_most_are_chosen_by_their_gain() -> None:
    """Of 21 cells that gain 0 to 20, the eleventh and the one above 95 % of all."""
    axis = Axis("ground_friction", low=1.0, high=3.0, count=21)
    grid = Grid([axis], fixed={"link_mass.torso": 4.0})
    evaluation = Evaluation(grid=grid, adaptations=2, episodes=1, threshold=1.0, draws=10)
    algorithm = learner(
        partial(MujocoEnv, task=Hopper()),
        TASKS,
        HillClimb(mode="sequential", queries=1, parallel=1, sigma=0.1),
    )
    gains = np.random.default_rng(0).permutation(21).astype(float)
    before, spread = np.zeros((1, 21, 2)), np.ones((1, 21, 2))
    after = before + gains[:, None] + np.array([-0.4, 0.4])
    scores = GridScores(grid, (), {}, ("seed 0",), (1,), (1,), 1, 2, before, after, spread, spread)
    found = evaluation.robots_to_film(algorithm, scores)
    assert found is not None and list(found) == ["median gain (+10)", "gain above 95% of all (+19)"]
    frictions = np.linspace(1.0, 3.0, 21)
    for (_, values), gain in zip(found.items(), (10, 19), strict=True):
        np.testing.assert_allclose(values, [4.0, frictions[int(np.flatnonzero(gains == gain)[0])]])
    assert evaluation.robots_to_film(algorithm, replace(scores, adaptation_episodes=0)) is None


@pytest.mark.render
@pytest.mark.usefixtures("draws")
def test_a_policy_that_does_not_adapt_is_filmed_alone(tmp_path: Path) -> None:
    """Domain randomization gives one clip."""
    env = partial(MujocoEnv, task=Hopper())
    path = Video(160, 120, 25, 0.1).record(learner(env, TASKS, NoAdaptation()), 0, tmp_path)
    assert path.name == "policy.mp4" and read(path)[0]["size"] == (160, 164)


@pytest.mark.render
@pytest.mark.usefixtures("draws")
def test_the_camera_shows_the_state() -> None:
    """A picture changes with the state, and the same state gives the same picture."""
    simulation = Simulation(Hopper())
    model, data = simulation.plant.batch.get_model(0), simulation.plant.batch.get_data(0)
    with Camera(model, 64, 64, "track") as camera:
        mujoco.mj_forward(model, data)
        first, again = camera.draw(model, data), camera.draw(model, data)
        data.qpos[2] = 1.0
        mujoco.mj_forward(model, data)
        tilted = camera.draw(model, data)
    assert np.array_equal(first, again)
    assert np.abs(first.astype(int) - tilted).mean() > 1


@pytest.mark.render
@pytest.mark.usefixtures("draws")
def test_the_film_s_return_is_that_of_the_whole_episode() -> None:
    """A film of a tenth of a second still tells what the whole episode returned."""
    env, still = EnvironmentFactory(partial(MujocoEnv, task=Hopper())).make(1), Acting(Still())
    base: Any = env.base_env
    simulation = base.rows
    model, values = simulation.plant.batch.get_model(0), simulation.space.neutral
    with Camera(model, 64, 64, None) as camera:
        clips = [
            record_clip(env, still, values, 7, "x", Video(64, 64, 25, s), camera)
            for s in (0.1, 100.0)
        ]
    assert len(clips[0].frames) == 3 and len(clips[1].frames) > 5
    assert clips[0].reward == clips[1].reward > 10


def test_a_small_task_has_no_film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is no MuJoCo model is refused by name."""
    monkeypatch.setattr(video, "library", lambda: "egl")
    algorithm = learner(partial(ToyEnv, Nav2D), NavGoals(), NoAdaptation())
    with pytest.raises(RenderError, match="Nav2D is not a MuJoCo task"):
        Video(64, 64, 25, 1.0).record(algorithm, 0, tmp_path)


def test_clips_are_labelled_and_the_shorter_waits() -> None:
    """Titles stand above, the caption below, and a clip that ends keeps its last picture."""
    short = Clip("before", np.full((2, 40, 101, 3), 50, np.uint8), 1.0)
    long = Clip("after", np.full((3, 40, 101, 3), 90, np.uint8), 2.0)
    frames = tile_clips([short, long], "mass = 3")
    assert frames.shape == (3, 84, 202, 3)
    assert (frames[:, 22:62, :101] == 50).all() and (frames[:, 22:62, 101:202] == 90).all()
    for text in (frames[:, :22, :101], frames[:, :22, 101:], frames[:, 62:, :101]):
        assert text.min() < 100 < text.max()


def test_a_film_keeps_its_pictures(tmp_path: Path) -> None:
    """Pictures come back in order and nearly as they were; a failed encoder leaves no file."""
    frames = np.repeat(np.array([40, 120, 200], np.uint8), 64 * 96 * 3).reshape(3, 64, 96, 3)
    write_mp4(tmp_path / "a.mp4", frames, 10)
    _, back = read(tmp_path / "a.mp4")
    assert back.shape == frames.shape
    assert np.abs(back.astype(int) - frames).mean() < 6
    with pytest.raises(RenderError):
        write_mp4(tmp_path / "b.mp4", frames[:, :0], 10)
    assert not (tmp_path / "b.mp4").exists()
