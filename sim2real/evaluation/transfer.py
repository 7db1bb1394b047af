"""Transfer: what a trained policy gets on named robots, such as its own and the one it is for.

    robots = {"source": {"domain": "source"}, "target": {"domain": "target"}}
    transfer = Transfer(robots, episodes=50)
    scores = transfer.assess(algorithm, env, seed=0, name="seed 0")
    scores.returns["target"]                        # (50,)
    transfer.report([scores], seed=0, out=folder)   # transfer-<steps>.json, transfer.md and .csv

A robot is the run's own task with some arguments changed, an effects.yaml put into it, or both. The
policy acts deterministically and does not adapt; every robot gets the same seeds of episodes, and
nothing is drawn: parameters that training randomized are as the model says. A policy that receives
its robot's parameters receives those of the named robot.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from envs.errors import did_you_mean
from envs.params import Parameter
from envs.plant import Fixed
from envs.randomization import Tasks
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.population.rollout import EpisodeResults
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

EPISODES = 4  # stream of randomness that follows from the evaluation's seed
EFFECTS = "effects"  # key of a robot that is not an argument of its task
Report = Callable[[int, int], None]


class TransferError(Sim2RealError):
    """Robots that cannot be made of a run's task, or a damaged file of scores."""


@dataclass(frozen=True)
class TransferScores:
    """One trained policy's returns on each robot."""

    name: str  # the name of the training run: its seed
    task: str  # name of the task's class
    trained_on: str | None  # the robot that is the run's own task, or None
    frames: int  # environment steps of the training
    robots: dict[str, dict[str, Any]]  # what makes each robot, by name
    returns: dict[str, np.ndarray]  # return of each episode, (E,), by robot
    lengths: dict[str, np.ndarray]  # control steps of each episode, (E,), by robot
    failed: dict[str, int]  # episodes that a simulation error ended, by robot

    def description(self) -> dict[str, Any]:
        """Return everything as JSON holds it."""
        robots = {
            robot: {
                "changes": changes,
                "returns": [round(x, 6) for x in self.returns[robot].tolist()],
                "lengths": self.lengths[robot].tolist(),
                "failed": self.failed[robot],
            }
            for robot, changes in self.robots.items()
        }
        about = {"name": self.name, "task": self.task, "trained_on": self.trained_on}
        return {**about, "training_steps": self.frames, "robots": robots}

    @classmethod
    def of(cls, about: Mapping[str, Any]) -> TransferScores:
        """Undo `description`; raises KeyError, TypeError or ValueError for anything else."""
        robots = about["robots"]
        return cls(
            str(about["name"]),
            str(about["task"]),
            about["trained_on"],
            int(about["training_steps"]),
            {robot: dict(found["changes"]) for robot, found in robots.items()},
            {robot: np.array(found["returns"], np.float64) for robot, found in robots.items()},
            {robot: np.array(found["lengths"], np.int64) for robot, found in robots.items()},
            {robot: int(found["failed"]) for robot, found in robots.items()},
        )


@dataclass(frozen=True)
class Transfer:
    """The robots and episodes of an evaluation.

    Raises:
        TransferError: no robot, or fewer than 1 episode.
    """

    # for each name, the arguments of the run's task that differ; `effects` names an effects.yaml
    # that is put into the robot besides
    robots: Mapping[str, Mapping[str, Any]]
    episodes: int  # on each robot

    def __post_init__(self) -> None:
        if not self.robots or self.episodes < 1:
            raise TransferError(
                f"eval: robots={list(self.robots)} and episodes={self.episodes}; "
                "at least one robot and one episode are needed"
            )

    def check(self, algorithm: Algorithm) -> None:
        """Raise TransferError for a robot that cannot be made of the run's task."""
        env = algorithm.parts.environment
        for robot, changes in self.robots.items():
            true_context(env, robot, env_with_robot(env, robot, dict(changes)))

    def assess(
        self, algorithm: Algorithm, seed: int, name: str, progress: Report | None = None
    ) -> TransferScores:
        """Run one trained policy on every robot; see `evaluate.Evaluator`.

        Raises:
            TransferError: a robot that cannot be made of the run's task, or a policy that is to
                adapt.
        """
        if algorithm.parts.adapt.episodes and "adapt" not in algorithm.uses:
            raise TransferError(
                "eval=transfer runs policies as they are trained; evaluate how one adapts on a "
                "grid, such as eval=grid_hopper, or leave adapt out"
            )
        env, trained = algorithm.parts.environment, algorithm.trained()
        worlds = {robot: env_with_robot(env, robot, dict(c)) for robot, c in self.robots.items()}
        seeds = draw_seeds(np.random.default_rng([seed, EPISODES]), self.episodes)
        played: dict[str, EpisodeResults] = {}
        for robot, world in worlds.items():
            said = true_context(env, robot, world)
            theta = None if said is None else np.append(trained.theta, said).astype(np.float32)
            played[robot] = trained.run_episodes(seeds, world, theta=theta)
            if progress is not None:
                progress(len(played), len(worlds))
        return TransferScores(
            name,
            type(task_of(env)).__name__,
            _own(env, worlds),
            algorithm.frames,
            {robot: dict(changes) for robot, changes in self.robots.items()},
            {robot: found.returns for robot, found in played.items()},
            {robot: found.lengths for robot, found in played.items()},
            {robot: int(found.failed.sum()) for robot, found in played.items()},
        )

    def report(
        self, scores: Sequence[TransferScores], seed: int, out: Path
    ) -> Sequence[TransferScores]:
        """Write transfer-<steps>.json with every episode, and transfer.md and .csv."""
        write(scores, seed, out)
        columns = ("run", "tested on", "mean return", "sd over episodes", "mean length")
        table = Table((*columns, "episodes", "training steps"))
        for one in scores:
            for robot, returns in one.returns.items():
                spread = float(returns.std(ddof=1)) if len(returns) > 1 else None
                length = float(one.lengths[robot].mean())
                here = f"{robot} (its own)" if robot == one.trained_on else robot
                cells = (one.name, here, float(returns.mean()), spread, length)
                table.add(*cells, len(returns), one.frames)
        table.write(Path(out) / "transfer")
        return scores


def write(scores: Sequence[TransferScores], seed: int, out: str | Path) -> Path:
    """Write scores into a folder; return the file."""
    steps = max((one.frames for one in scores), default=0)
    document = {"schema": 1, "seed": seed, "runs": [one.description() for one in scores]}
    return write_text(Path(out) / f"transfer-{steps}.json", json.dumps(document) + "\n")


def read(path: str | Path) -> list[TransferScores]:
    """Read what `write` wrote.

    Raises:
        TransferError: a file that is missing or damaged.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
        return [TransferScores.of(one) for one in document["runs"]]
    except (OSError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise TransferError(
            f"{path} is incomplete or damaged ({error}). Run `sim2real evaluate` again"
        ) from error


def task_of(env: EnvironmentFactory) -> Any:
    """Return the task that an environment is made of; raises TransferError where there is none."""
    if env.task is None:
        raise TransferError(
            f"eval: {env.name} has no task whose arguments could differ between robots; choose an "
            "env of the simulator, such as env=hopper_polito"
        )
    return env.task


def env_with_robot(
    env: EnvironmentFactory, robot: str, changes: dict[str, Any]
) -> EnvironmentFactory:
    """Return the environment with another robot in it.

    The effects that were put into the run's simulator are left out: they correct a simulator, and a
    robot is what it is.

    Args:
        env: the run's own environment.
        robot: its name, for messages.
        changes: arguments of the task, and `effects`.

    Raises:
        TransferError: an argument that the task does not take.
        EnvsError: a value that it refuses, or a wrong effects.yaml.
    """
    effects = changes.pop(EFFECTS, None)
    task = task_of(env)
    known = task_arguments(task)
    for key in changes:
        if key not in known:
            raise TransferError(
                f"eval.robots.{robot}: {type(task).__name__} does not accept {key!r}"
                f"{did_you_mean(key, known)}; it accepts: {', '.join([*known, EFFECTS])}"
            )
    given = {**env.base.keywords, "task": type(task)(**(known | changes))}
    changed = env.with_base(partial(env.base.func, *env.base.args, **given))
    return changed.with_effects(effects)


def true_context(
    env: EnvironmentFactory, robot: str, world: EnvironmentFactory
) -> np.ndarray | None:
    """Return what a policy receives of a named robot, (P,), -1 to 1 over the ranges of training.

    What training added to the run's own model, or multiplied there, is relative to that model.

    Args:
        env: the run's own environment.
        robot: its name, for messages.
        world: the environment with it, of `env_with_robot`.

    Returns:
        None where the policy does not receive true parameters.

    Raises:
        TransferError: an effect of the robot that says what cannot be said as in training.
    """
    context = env.context_spec
    if context is None or not env.context_is_true:
        return None
    own = _levels(env, env.tasks, env.fixed, robot)
    there = _levels(world, env.tasks, [*task_of(world).fixed(), *world.fixed], robot)
    truth = []
    for p in context.parameters:
        before, now = own[p.name], there[p.name]
        if p.how == "add":
            now -= before
        elif p.how == "scale":
            now = 1.0 if now == before else np.divide(now, before)
        truth.append(now)
    return context.normalize(np.array(truth), np.inf)


def _levels(
    world: EnvironmentFactory, tasks: Tasks, fixed: Sequence[Fixed], robot: str
) -> dict[str, float]:
    """Return the parameters of tasks in a world with fixed effects, absolute where they can be."""
    places = {(effect.name, effect.where) for effect in tasks.effects}
    others = [one for one in world.fixed if (one[0].name, one[0].where) not in places]
    rows: Any = replace(world, tasks=tasks, fixed=others).base_rows(1, threads=1)
    model, known = rows.plant.model, dict[str, Parameter]()
    for effect in map(copy, tasks.effects):
        effect.how = "set" if "set" in effect.hows else effect.how
        known |= {p.name: p for p in effect.parameters(model)}
    levels = {name: p.neutral for name, p in known.items()}
    for effect, values in fixed:
        for p, value in zip(effect.parameters(model), np.ravel(values).tolist(), strict=True):
            if (drawn := known.get(p.name)) is None:
                continue
            if p.side != drawn.side or drawn.how not in ("set", p.how):
                raise TransferError(
                    f"eval.robots.{robot}: {p.name} has how={p.how}, side={p.side}, but the policy "
                    f"receives how={drawn.how}, side={drawn.side}; write the effect so, or remove "
                    f"the robot (~eval.robots.{robot})"
                )
            level = levels[p.name]
            levels[p.name] = {"set": value, "add": level + value, "scale": level * value}[p.how]
    return levels


def task_arguments(task: Any) -> dict[str, Any]:
    """Return the arguments that a task was made with; it keeps each under its name."""
    return {name: getattr(task, name) for name in inspect.signature(type(task)).parameters}


def _own(env: EnvironmentFactory, worlds: Mapping[str, EnvironmentFactory]) -> str | None:
    """Return the name of the robot that equals the run's own."""
    own = task_arguments(task_of(env)), list(env.fixed)
    for robot, world in worlds.items():
        if (task_arguments(task_of(world)), list(world.fixed)) == own:
            return robot
    return None
