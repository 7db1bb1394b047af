"""The environment of a run: a base, what is done to what it shows, and which robots there are.

    env = make_env(compose(["env=hopper", "params=mass_friction"]), num_envs=256)
    env.rollout(100)                                # a torchrl.envs.TransformedEnv

Training, evaluation, export and deployment make theirs here, so that all of them see the same:

    environment = EnvironmentFactory(partial(MujocoEnv, task=Hopper()), tasks, transforms)
    env = environment.make(num_envs=32, seed=0)     # an EnvBase with all transforms
    rows = environment.rows(64, threads=1)          # the same world as rows, for populations

A base is any class or function that takes `num_envs` and `device` and returns an `EnvBase` of batch
size (num_envs,). A `MujocoEnv` also takes what differs between its robots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torchrl.envs import Compose, EnvBase, Transform, TransformedEnv

from envs.effects.file import load_effects
from envs.mujoco import MujocoEnv
from envs.plant import Fixed
from envs.randomization import Randomization, Tasks
from envs.rows import Rows
from envs.tasks.base import Task
from envs.torch_env import RandomizeParams, RowsEnv
from envs.toys.env import ToyEnv
from sim2real.config.targets import build, build_named
from sim2real.learning.context import AppendContext, ContextRows, ContextSpec
from sim2real.learning.population.env_rows import EnvRows
from sim2real.learning.student import EstimateContext, Student
from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True)
class EnvironmentFactory:
    """A factory of a run's environments.

    Raises:
        Sim2RealError: tasks with effects, or fixed ones, for a world that simulates no robot.
    """

    base: partial[EnvBase]  # makes the world
    tasks: Tasks = field(default_factory=Randomization)  # which robots its episodes meet
    # by name, in order, what makes the transforms of what it shows; `RandomizeParams` is given
    # the tasks, `AppendContext` what they draw
    transforms: Mapping[str, Callable[..., Transform]] = field(default_factory=dict)
    fixed: Sequence[Fixed] = ()  # effects that every robot has, with their values

    def __post_init__(self) -> None:
        if self.tasks.effects and not self.simulated:
            raise Sim2RealError(
                f"{self.base.func.__name__} accepts no effects, but the tasks need "
                f"{len(self.tasks.effects)}; use the environment's own tasks"
            )

    @property
    def simulated(self) -> bool:
        """Whether the base is one of the simulator, whose robots can differ."""
        return isinstance(self.base.func, type) and issubclass(self.base.func, MujocoEnv)

    @property
    def on_device(self) -> bool:
        """Whether its robots are simulated where tensors are, by MuJoCo Warp."""
        return self.simulated and self.base.keywords.get("physics", "batch") == "warp"

    @property
    def on_host(self) -> EnvironmentFactory:
        """Return the same world simulated on the CPU: to look at it, or for who reads its state."""
        if not self.on_device:
            return self
        given = {**self.base.keywords, "physics": "batch"}
        return replace(self, base=partial(self.base.func, *self.base.args, **given))

    @property
    def task(self) -> Task | None:
        """The simulated task; None for an environment without a robot."""
        return _argument(self.base, "task") if self.simulated else None

    @property
    def name(self) -> str:
        """The name of what is learned, for checkpoints: that of the task, or else of the base."""
        if self.task is not None:
            return type(self.task).__name__
        made = _argument(self.base, "toy") if self.base.func is ToyEnv else self.base
        return made.func.__name__ if isinstance(made, partial) else made.__name__

    @property
    def has_transforms(self) -> bool:
        """Whether the only transform is the one that draws robots."""
        return all(_randomizes(one) for one in self.transforms.values())

    @cached_property
    def context_spec(self) -> ContextSpec | None:
        """The robot's parameters that the policy receives; None: none.

        Raises:
            Sim2RealError: tasks without ranges, or an environment that is not one over rows.
        """
        for one in self.transforms.values():
            if _tells(one):
                return _keywords(one).get("context") or ContextSpec.from_tasks(
                    self.tasks, self.base_rows(1, threads=1).space
                )
        return None

    @property
    def context_is_true(self) -> bool:
        """Whether policies receive the true parameters of simulated robots."""
        return any(
            _tells(one) and "student" not in _keywords(one) and _keywords(one).get("truth", True)
            for one in self.transforms.values()
        )

    def with_estimated_context(self, student: Student) -> EnvironmentFactory:
        """Return this with policies that receive a student's estimates instead of the truth."""

        def guess(one: Callable[..., Transform]) -> Callable[..., Transform]:
            own = {k: v for k, v in _keywords(one).items() if k not in ("context", "truth")}
            own |= {"context": self.context_spec, "student": student}
            return partial(EstimateContext, **own)

        transforms = {
            name: guess(one) if _tells(one) else one for name, one in self.transforms.items()
        }
        return replace(self, transforms=transforms)

    def with_effects(self, effects: str | Path | None) -> EnvironmentFactory:
        """Return this with the effects of a file in every robot; None changes nothing.

        Raises:
            EffectError: a file that is missing or wrong.
            Sim2RealError: a world that has no robot to put effects into.
        """
        if effects is None:
            return self
        if not self.simulated:
            raise Sim2RealError(
                f"effects={effects}: {self.name} does not simulate a robot that can have them; "
                f"remove effects, or choose an env of the simulator, such as env=hopper"
            )
        return replace(self, fixed=load_effects(effects))

    def with_task(self, task: Task) -> EnvironmentFactory:
        """Return this with another task of the same robot.

        Raises:
            Sim2RealError: a world that simulates no robot.
        """
        if not self.simulated:
            raise Sim2RealError(
                f"{self.name} does not simulate a robot; choose a task such as env=quad8"
            )
        others = {name: value for name, value in self.base.keywords.items() if name != "task"}
        return replace(self, base=partial(self.base.func, task, *self.base.args[1:], **others))

    def with_base(self, base: partial[EnvBase]) -> EnvironmentFactory:
        """Return the same transforms over another base, whose robots are what they are."""
        context = self.context_spec
        made = self if context is None else self.with_context_spec(context)
        return replace(made, base=base, tasks=Randomization(), fixed=())

    def with_context_spec(self, context: ContextSpec) -> EnvironmentFactory:
        """Return this with policies that receive these parameters, whatever robots are drawn."""
        transforms = {
            name: partial(one, context=context) if _tells(one) else one
            for name, one in self.transforms.items()
        }
        return replace(self, transforms=transforms)

    def make(
        self,
        num_envs: int,
        threads: int = 0,
        device: torch.device | str = "cpu",
        seed: int = 0,
        extra: Sequence[Transform] = (),
    ) -> SerializableEnv:
        """Make an environment with all transforms.

        Args:
            num_envs: N, its batch size.
            threads: threads of the physics; 0 for all cores.
            device: device of the tensors.
            seed: seed of the episodes.
            extra: transforms appended to the others, such as a policy's primers.

        Raises:
            Sim2RealError: a base that is not an environment of that batch size, a transform whose
                keys are not there.
        """
        base = self._base(num_envs, threads, device)
        env = SerializableEnv(base, self, seed)
        for name, one in self.transforms.items():
            made = self._transform(one)
            if not isinstance(made, Transform):
                raise Sim2RealError(
                    f"transforms.{name} is a {type(made).__name__}, not a transform; give a class "
                    "that inherits from torchrl.envs.Transform"
                )
            self._append(env, name, made)
        for one in extra:
            env.append_transform(one)
        env.transform.train()  # statistics follow what is shown; TorchRL makes environments frozen
        env.set_seed(seed)
        return env

    def _transform(self, one: Callable[..., Transform]) -> Any:
        if _randomizes(one):
            return one(tasks=self.tasks)
        return one(context=self.context_spec) if _tells(one) else one()

    def _append(self, env: TransformedEnv, name: str, transform: Transform) -> None:
        """Put a transform behind the others, and see that what it reads is there."""
        there = {_word(key) for key in env.full_observation_spec.keys(True, True)}
        there |= {_word(key) for key in (*env.reward_keys, *env.done_keys, *env.action_keys)}
        there |= {"terminated", "truncated", "_reset", "reward"}
        lacking = [key for key in transform.in_keys or () if _word(key) not in there]
        if lacking:
            raise Sim2RealError(
                f"transforms.{name}: {type(transform).__name__} reads {_word(lacking[0])!r}, which "
                f"is missing; available before it: {', '.join(sorted(there - {'_reset'}))}"
            )
        env.append_transform(transform)

    def _base(self, num_envs: int, threads: int, device: torch.device | str) -> EnvBase:
        given: dict[str, Any] = {"num_envs": num_envs, "device": device}
        if self.simulated:
            given |= {"threads": threads, "effects": self.tasks.effects, "fixed": self.fixed}
        base = self.base(**given)
        if not isinstance(base, EnvBase):
            raise Sim2RealError(
                f"env: {self.base.func.__name__} makes a {type(base).__name__}, not a torchrl "
                f"EnvBase"
            )
        if tuple(base.batch_size) != (num_envs,):
            raise Sim2RealError(
                f"env: {self.base.func.__name__} has batch size {tuple(base.batch_size)}, asked "
                f"for ({num_envs},); an environment takes num_envs and holds as many"
            )
        return base

    def rows(self, num_rows: int, threads: int = 1, device: torch.device | str = "cpu") -> Rows:
        """Make the world as rows, which restart one by one and where each may have its own policy.

        Rows of a simulator are taken as they are, unless transforms change what they show by more
        than their parameters.

        Raises:
            Sim2RealError: a world, or transforms, that rows cannot have; see `EnvRows`.
        """
        telling = [one for one in self.transforms.values() if not _randomizes(one)]
        guessing = any("student" in _keywords(one) for one in telling)
        if self.has_transforms or (len(telling) == 1 and _tells(telling[0]) and not guessing):
            base = self._base(num_rows, threads, device)
            if isinstance(base, RowsEnv):
                rows = base.rows
                for one in telling:
                    rows = ContextRows(rows, self._transform(one))
                return rows
            base.close()
        others = {name: one for name, one in self.transforms.items() if not _randomizes(one)}
        return EnvRows(replace(self.on_host, transforms=others).make(num_rows, threads))

    def base_rows(self, num_rows: int, threads: int = 0) -> Any:
        """Make the rows under the environment, without what transforms do to what they show.

        They are simulated on the CPU.

        Raises:
            Sim2RealError: a world that is not one over rows.
        """
        base = self.on_host._base(num_rows, threads, "cpu")
        if not isinstance(base, RowsEnv):
            raise Sim2RealError(
                f"{self.name} does not consist of rows; choose one such as env=hopper"
            )
        return base.rows

    def observation_and_action_spec(self) -> tuple[int, np.ndarray, np.ndarray]:
        """Return observation size and the actions' limits, (A,) each, of the base's rows.

        Raises:
            Sim2RealError: a world that is not one over rows.
        """
        rows = self.base_rows(1, threads=1)
        return rows.observation_size, rows.action_low, rows.action_high


class SerializableEnv(TransformedEnv):
    """An environment that knows what it was made of, so that another process can make it, too.

    Args:
        base: the world.
        made: what makes it and its transforms.
        seed: of its episodes.
    """

    def __init__(self, base: EnvBase, made: EnvironmentFactory, seed: int) -> None:
        super().__init__(base, Compose([]))
        self.made, self.seed = made, seed

    def set_seed(self, seed: int | None = None, static_seed: bool = False) -> int | None:
        """Seed the world's episodes, and the draws of their robots; return the next seed."""
        chain: Any = self.transform
        for one in chain:
            if isinstance(one, RandomizeParams):
                one.set_seed(seed)
        return super().set_seed(seed, static_seed)


def make_env(
    config: Mapping[str, Any] | EnvironmentFactory,
    num_envs: int = 1,
    device: torch.device | str = "cpu",
    seed: int = 0,
) -> TransformedEnv:
    """Make the environment that a configuration describes, transforms included.

    Args:
        config: a composed tree (`sim2real.config.compose.compose`) whose env, transforms, params
            and effects count, built or not; or an `EnvironmentFactory`.
        num_envs: N, its batch size.
        device: where tensors go.
        seed: the seed of its episodes.

    Raises:
        Sim2RealError: parts that do not fit together.
    """
    made = config if isinstance(config, EnvironmentFactory) else environment_of(config)
    return made.make(num_envs, device=device, seed=seed)


def environment_of(config: Mapping[str, Any]) -> EnvironmentFactory:
    """Return the environment of a composed tree; see `make_env`.

    Raises:
        ConfigError: a tree that describes none.
    """
    transforms = build_named(config.get("transforms"), "transforms")
    made = {key: build(config[key], key) for key in ("env", "params")}
    environment = EnvironmentFactory(made["env"], made["params"], transforms)
    return environment.with_effects(config.get("effects"))


def _argument(base: partial[EnvBase], name: str) -> Any:
    """Return the base's first argument, given by name or by position."""
    return base.keywords[name] if name in base.keywords else base.args[0]


def _randomizes(one: Callable[..., Transform]) -> bool:
    return _made(one) is RandomizeParams


def _tells(one: Callable[..., Transform]) -> bool:
    made = _made(one)
    return isinstance(made, type) and issubclass(made, AppendContext)


def _made(one: Callable[..., Transform]) -> Callable[..., Transform]:
    """Return the function inside nested partials."""
    while isinstance(one, partial):
        one = one.func
    return one


def _keywords(one: Callable[..., Transform]) -> dict[str, Any]:
    """Return the arguments that were given already by name."""
    return {**_keywords(one.func), **one.keywords} if isinstance(one, partial) else {}


def _word(key: Any) -> str:
    return key if isinstance(key, str) else ".".join(key)
