"""ES-MAML: evolution strategies over policies that are scored after they have adapted.

    parts = Components(environment, policy, adapt=HillClimb(...), seed=0)
    algorithm = ESMAML(parts, ESMAMLSettings(num_rows=64, shards=None, sigma=0.05, ...))
    while algorithm.frames < 20_000_000:
        metrics = algorithm.iterate()

After Song et al. 2020, "ES-MAML: simple Hessian-free meta learning". Each candidate is a member: it
meets a task that it has not seen, adapts there for a few episodes, and its fitness is the mean
return of fresh episodes afterwards. No gradient passes through the adaptation, so it may be
anything. With `NoAdaptation` this is evolution strategies under domain randomization; with fixed
parameters as tasks it is plain evolution strategies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from torch import nn

from sim2real.learning.adapt import Adaptation, NoAdaptation
from sim2real.learning.adapt.first_order import FirstOrder, FirstOrderCohort
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.algorithms.checks import check_same_policy
from sim2real.learning.algorithms.shards import make_shards
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.learning.modules.value import Critic
from sim2real.learning.population.actors import ActorPolicy, flat_policy
from sim2real.learning.population.es import EvolutionStrategy, StrategySettings
from sim2real.learning.population.population import (
    AdaptationScores,
    Population,
    PopulationRequest,
    PopulationResult,
    draw_seeds,
    evaluate_adaptation,
)
from sim2real.learning.trained import TrainedPolicy
from sim2real.learning.transforms import affine
from sim2real.runs.errors import CheckpointError, Sim2RealError


@dataclass(frozen=True, kw_only=True)
class RowsSettings:
    """The layout of parallel episodes; it changes the speed, not the results."""

    num_rows: int  # episodes that run side by side, in all shards
    shards: int | None  # environments that share the cores; None chooses, see `make_shards`
    refill: int  # see `Population`


@dataclass(frozen=True, kw_only=True)
class FitnessSettings:
    """The fitness of a candidate.

    Args:
        paired_tasks: whether both members of a pair (forward_fd: all members) get the same tasks,
            perturbations and episode seeds; false draws each member's own, as the reference does.
        tasks_per_member: tasks that a candidate's fitness averages over.
        final_episodes: episodes that score an adapted policy.
        step_cost: subtracted from the fitness for each control step of the final episodes. The
            task's bonus for being upright, taken out again, no longer rewards standing still (Mania
            et al. 2018, section 4.1); returns that are logged and seen by adaptation keep it.
        clean_final: names of parameters that are neutral in the final episodes, such as a task's
            return noise.

    Raises:
        Sim2RealError: for values out of range.
    """

    paired_tasks: bool
    tasks_per_member: int
    final_episodes: int
    step_cost: float
    clean_final: Sequence[str]

    def __post_init__(self) -> None:
        if self.tasks_per_member < 1 or self.final_episodes < 1:
            raise Sim2RealError(
                f"algorithm: tasks_per_member={self.tasks_per_member} and "
                f"final_episodes={self.final_episodes} must be at least 1"
            )


@dataclass(frozen=True, kw_only=True)
class ESMAMLSettings(StrategySettings, FitnessSettings, RowsSettings):
    """All settings of ES-MAML under one name each; called with parts, they make the algorithm.

    Args:
        normalize_observations: whether the policy sees observations with the running mean and std
            taken out, frozen within an iteration.
        meta_estimator: "zeroth_order" perturbs the meta-parameters and scores what they adapt to;
            "first_order" takes the gradient at the adapted parameters, of `pairs` tasks.
        first_order_queries: episodes of each gradient estimate of "first_order".
        warm_up: environment steps at the start during which candidates are scored as they are: an
            unadapted candidate costs one episode, and what adapts well later begins with what
            works at all.
        critic: whether the policy's critic is searched as well as its actor, for an adaptation that
            learns by it.

    Raises:
        Sim2RealError: for values out of range.
    """

    normalize_observations: bool
    meta_estimator: Literal["zeroth_order", "first_order"]
    first_order_queries: int
    warm_up: int = 0
    critic: bool = False

    def __post_init__(self) -> None:
        StrategySettings.__post_init__(self)
        FitnessSettings.__post_init__(self)
        if self.warm_up < 0:
            raise Sim2RealError(f"algorithm.warm_up={self.warm_up} must not be negative")
        if self.meta_estimator not in ("zeroth_order", "first_order"):
            raise Sim2RealError(
                f"algorithm.meta_estimator={self.meta_estimator!r} is not one of "
                "zeroth_order, first_order"
            )

    def __call__(self, parts: Components) -> ESMAML:
        """Return the algorithm."""
        return ESMAML(parts, self)


class ESMAML(Algorithm):
    """Meta-learns parameters that adapt well.

    Args:
        parts: the environment, whose tasks members adapt to, one draw each; the policy, an
            `MLPPolicy` or any with an actor of tensordict modules; the adaptation operator.
        settings: how it searches, what counts and where episodes run.

    Raises:
        Sim2RealError: for tasks or a policy that the environment cannot have.
    """

    uses = frozenset({"adapt"})

    def __init__(self, parts: Components, settings: ESMAMLSettings) -> None:
        self.parts, self.tasks, self.adapt = parts, parts.tasks, parts.adapt
        self._settings = settings
        rows = make_shards(parts.environment, settings.num_rows, settings.shards, parts.device)
        with TorchRandomStream(parts.seed, "cpu"):
            env = parts.environment.on_host.make(1, threads=1)
            self.policy = flat_policy(parts.policy(env), env, settings.critic)
        self._raw = affine(env)  # (O,) each: of what the base shows; None: the policy sees others
        self.population: Population = Population(rows, self.policy, settings.refill)
        space = self.population.space
        self.tasks.check(space)
        self._clean = [space.index(name) for name in settings.clean_final]
        start, search, self._rng = (
            np.random.default_rng(s) for s in np.random.SeedSequence(parts.seed).spawn(3)
        )
        self.strategy = EvolutionStrategy(self.policy.initial(start), search, settings)
        first_order = settings.meta_estimator == "first_order"
        self._first_order = (
            FirstOrder(self.adapt, settings.first_order_queries) if first_order else None
        )
        size = self.policy.observation_size
        self.normalizer = Normalizer(size) if settings.normalize_observations else None
        self._paid = Normalizer(1)  # discounted returns, whose deviation is the critic's unit
        self.frames = self.iteration = 0

    @property
    def theta(self) -> np.ndarray:
        """The meta-parameters, (P,) float32."""
        return self.strategy.mean.astype(np.float32)

    @property
    def shape(self) -> dict[str, Any]:
        """The policy's sizes and nonlinearities."""
        return dict(self.policy.shape)

    def trained(self) -> TrainedPolicy:
        """Return the policy of the meta-parameters."""
        seen = self.normalizer or Normalizer(self.policy.observation_size)
        policy, mean, std, raw = self.policy, seen.mean.copy(), seen.std.copy(), self._raw

        def program(theta: np.ndarray) -> nn.Module:
            assert raw is not None
            return policy.module(theta, raw[0] + raw[1] * mean, raw[1] * std)

        return TrainedPolicy(
            self.theta[: getattr(policy, "actor_parameters", None)],
            lambda theta: policy.acting(theta, mean, std),
            self.parts.environment,
            {},
            self.frames,
            primers=policy.primers,
            program=program if policy.is_function and raw is not None else None,
            dtype=torch.float64,
            critic=self._critic(),
            clips_actions=policy.cut,
        )

    def _critic(self) -> Critic | None:
        """Return the critic of the meta-parameters; None where it is not searched."""
        if not self._settings.critic:
            return None
        assert isinstance(self.policy, ActorPolicy)
        return self.policy.valuing(self.theta, float(self._paid.std[0]))

    def _operator(self) -> Adaptation:
        """Return the adaptation for the present critic."""
        if not self.adapt.needs_critic:
            return self.adapt
        return self.adapt.bind_policy(getattr(self.policy, "actor", None), self._critic())

    def scores(self, values: np.ndarray, seeds: np.ndarray, episodes: int) -> AdaptationScores:
        """Return the returns before and after adaptation; see `evaluate_adaptation`."""
        return evaluate_adaptation(
            self.population, self.theta, self.normalizer, self._operator(), values, seeds, episodes
        )

    def adapted(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """Return the parameters, (P,), that the policy adapts to on a robot of values (P,)."""
        if isinstance(self.adapt, NoAdaptation):
            return None
        (rows,) = make_shards(self.parts.environment.on_host, 1, 1)
        cohort = self._operator().start_many(self.theta[None], [rng])
        seeds = draw_seeds(rng, (1, self.adapt.episodes))
        members = PopulationRequest(cohort, values[None], values[None], seeds)
        found = Population([rows], self.policy).run(members, self.normalizer).thetas[0]
        return found[: len(self.trained().theta)]

    def iterate(self) -> dict[str, float]:
        """Evaluate one generation of candidates and move the meta-parameters."""
        warm = self.frames < self._settings.warm_up
        if warm or self._first_order is None:
            results, moved = self._zeroth_order(NoAdaptation() if warm else self._operator())
        else:
            results, moved = self._first_order_step()
        if self.normalizer is not None:
            self.normalizer.update(results.frames, results.sums, results.squares)
        self._note_paid(results)
        self.frames += results.frames
        self.iteration += 1
        adapts = results.adaptation_episodes > 0
        before = results.returns[:, 0] if adapts else results.final.mean(axis=1)
        return {
            "train/return": float(results.final.mean()),
            "train/return_before": float(before.mean()),
            "train/episode_length": float(results.lengths.mean()),
            "train/failed": float(results.failed.mean()),
            "train/gradient_norm": moved["gradient_norm"],
            "train/frames": float(self.frames),
        }

    def _note_paid(self, results: PopulationResult) -> None:
        """Take the discounted returns of members that learned from their steps into account."""
        if not self._settings.critic:
            return
        steps = int(results.lengths[:, : results.adaptation_episodes].sum())
        mean, (total, squares) = self._paid.mean, results.paid
        off = squares - 2 * mean * total + steps * mean**2
        self._paid.update(steps, total - steps * mean, off)

    def _zeroth_order(self, adapt: Adaptation) -> tuple[PopulationResult, dict[str, float]]:
        candidates = self.strategy.ask().astype(np.float32)  # (J, P)
        repeats = self._settings.tasks_per_member
        thetas = np.repeat(candidates, repeats, axis=0)  # (J T, P)
        results = self._run(adapt, thetas, self._draws(len(candidates)))
        lengths = results.lengths[:, results.adaptation_episodes :]
        scores = results.final - self._settings.step_cost * lengths  # (J T, F)
        fitness = scores.reshape(len(candidates), -1).mean(axis=1)
        return results, self.strategy.tell(fitness)

    def _first_order_step(self) -> tuple[PopulationResult, dict[str, float]]:
        assert self._first_order is not None
        count = self._settings.pairs * self._settings.tasks_per_member
        members = self._members(
            self._first_order, np.tile(self.theta, (count, 1)), np.arange(count)
        )
        results = self.population.run(members, self.normalizer)
        assert isinstance(members.cohort, FirstOrderCohort)
        return results, self.strategy.step(members.cohort.gradients.mean(axis=0))

    def _draws(self, candidates: int) -> np.ndarray:
        """Return which draw of task and luck each member gets, (J T,): equal numbers share one."""
        if not self._settings.paired_tasks:
            groups = np.arange(candidates)
        elif self.strategy.estimator == "antithetic":
            groups = np.tile(np.arange(self._settings.pairs), 2)
        else:
            groups = np.zeros(candidates, np.int64)
        repeats = self._settings.tasks_per_member
        return (groups[:, None] * repeats + np.arange(repeats)).ravel()

    def _run(self, adapt: Adaptation, thetas: np.ndarray, draws: np.ndarray) -> PopulationResult:
        return self.population.run(self._members(adapt, thetas, draws), self.normalizer)

    def _members(
        self, adapt: Adaptation, thetas: np.ndarray, draws: np.ndarray
    ) -> PopulationRequest:
        """Draw tasks, perturbations and episode seeds, and hand each member those of its draw."""
        count = int(draws.max()) + 1
        values = self.tasks.sample(self._rng, count)
        noise_seeds = draw_seeds(self._rng, count)
        seeds = draw_seeds(self._rng, (count, adapt.episodes + self._settings.final_episodes))
        final_values = values.copy()
        final_values[:, self._clean] = self.population.space.neutral[self._clean]
        noise = np.empty((count, adapt.queries, thetas.shape[1]), np.float32)
        for draw, seed in enumerate(noise_seeds.tolist()):
            noise[draw] = adapt.draw(np.random.default_rng(seed), thetas.shape[1])
        cohort = adapt.start_batch(thetas, noise[draws])
        return PopulationRequest(cohort, values[draws], final_values[draws], seeds[draws])

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on."""
        return {
            "policy": self.policy.shape,
            "strategy": self.strategy.state_dict(),
            "normalizer": None if self.normalizer is None else self.normalizer.state_dict(),
            "paid": self._paid.state_dict(),
            "rng": self._rng.bit_generator.state,
            "frames": self.frames,
            "iteration": self.iteration,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned.

        Raises:
            CheckpointError: for a state of another policy or another normalization.
        """
        check_same_policy(state["policy"], self.policy.shape)
        if (state["normalizer"] is None) != (self.normalizer is None):
            raise CheckpointError(
                "checkpoint: normalize_observations differs between the checkpoint and this run; "
                "restore the value of algorithm.normalize_observations"
            )
        self.strategy.load_state_dict(state["strategy"])
        if self.normalizer is not None:
            self.normalizer.load_state_dict(state["normalizer"])
        if "paid" in state:
            self._paid.load_state_dict(state["paid"])
        self._rng.bit_generator.state = state["rng"]
        self.frames, self.iteration = int(state["frames"]), int(state["iteration"])
