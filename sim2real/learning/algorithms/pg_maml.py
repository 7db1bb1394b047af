"""PG-MAML: parameters from which one policy gradient leads far in any task (Finn et al. 2017).

    parts = Components(environment, policy, adapt=PolicyGradient(...), collector=..., seed=0)
    algorithm = PGMAML(parts, step=NaturalStep(...), task_batch=20, steps=100, ...)
    while algorithm.iteration < 500:
        metrics = algorithm.iterate()

One iteration draws tasks, runs episodes in each, adapts to each by the operator's step, runs as
many episodes of what it adapted to, and moves the parameters along the natural gradient of those
returns, differentiated through the adaptation. With `ClippedSteps` and a surrogate "ratio" it is
ProMP (Rothfuss et al. 2019).
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase

from envs.torch_env import RowsEnv
from sim2real.learning.adapt import PolicyGradient
from sim2real.learning.adapt.policy_gradient import TransitionBatch
from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.checks import check_at_least, check_finite
from sim2real.learning.algorithms.collecting import ResumableCollector
from sim2real.learning.algorithms.resumable import CollectingAlgorithm
from sim2real.learning.collectors.by_task import TaskActor, TaskBatch, check_batch
from sim2real.learning.losses.meta import MetaObjective
from sim2real.learning.modules.actor_critic import Policy, check_policy
from sim2real.learning.modules.functional_actor import FunctionalActor
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.learning.optimizers.clipped import ClippedSteps
from sim2real.learning.optimizers.natural import NaturalStep, StepResult
from sim2real.learning.population.gradient_adaptation import adapt_to
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class PGMAML(CollectingAlgorithm):
    """Meta-learns an actor that adapts by a policy gradient.

    Args:
        parts: environment, policy, adaptation (`PolicyGradient` in training) and collector; an
            optimizer for `ClippedSteps`.
        step: how the parameters move.
        task_batch: B, tasks of an iteration; each has the operator's number of episodes, before and
            after adaptation.
        steps: T, of an episode at most.
        fisher_states: steps of all tasks that the divergence's curvature is estimated from.
        first_order: whether the adaptation's second derivatives are left out.

    Raises:
        Sim2RealError: for values out of range, or parts that do not fit together.
    """

    uses = frozenset({"adapt", "collector", "optimizer"})
    adapts_by = PolicyGradient

    def __init__(
        self,
        parts: Components,
        *,
        step: NaturalStep | ClippedSteps,
        task_batch: int,
        steps: int,
        fisher_states: int,
        first_order: bool,
    ) -> None:
        check_at_least(1, task_batch=task_batch, steps=steps)
        check_at_least(task_batch, fisher_states=fisher_states)
        check_batch(parts.tasks, task_batch)
        if isinstance(step, ClippedSteps) == (parts.optimizer is None):
            need = "needs an optimizer" if parts.optimizer is None else "uses no optimizer"
            raise Sim2RealError(
                f"optimizer: the step {type(step).__name__} {need}; ClippedSteps is taken with "
                "optimizer=adam, NaturalStep with optimizer=none"
            )
        self.parts, self._step = parts, step
        self._tasks, self._states, self._first_order = task_batch, fisher_states, first_order
        adapt = parts.adapt  # another one, or none, only to evaluate a trained policy
        self._each = adapt.trajectories if isinstance(adapt, PolicyGradient) else 1
        self._randomness = TorchRandomStream(parts.seed, parts.device)
        self._held = TaskBatch(parts.tasks, self._each)
        with self._randomness:
            env = replace(parts.environment, tasks=self._held).make(
                task_batch * self._each, device=parts.device, seed=parts.seed
            )
            self.policy = _made(parts.policy(env)).to(parts.device)
            check_policy(env, self.policy)
            self._law = FunctionalActor(self.policy.actor)
            self._actor = TaskActor(self._law, task_batch)
            begun = partial(parts.part("collector"), reset_at_each_iter=True)
            frames = task_batch * self._each * steps
            self.collecting = ResumableCollector(
                replace(parts, collector=begun), env, self._actor, frames
            )
            made = parts.optimizer
            self._optimizer = None if made is None else made(self._law.parameters)
        if not isinstance(env.base_env, RowsEnv) or not self.collecting.in_rows:
            raise Sim2RealError(
                "algorithm=pg_maml keeps each row in its task, which needs an environment in this "
                "process, such as env=nav2d, and collector=fast or collector=sync"
            )
        self._base: RowsEnv = env.base_env
        self.frames = self.iteration = 0

    def iterate(self) -> dict[str, float]:
        """Adapt to a batch of tasks, and learn from what came of it."""
        operator = self.parts.adapt
        assert isinstance(operator, PolicyGradient)
        with self._randomness:
            self._base.randomize(self._held)
            start = self._law.vector()
            data = self._collect(start)
            before = self._experience(operator, data)
            thetas = torch.func.vmap(lambda one: operator.step(self._law, start, one))(before)
            later = self._collect(thetas)
            after = self._experience(operator, later)
            objective = MetaObjective(
                self._law, operator, before, after, start, first_order=self._first_order
            )
            taken = self._improve(objective)
        self._law.load(taken.theta)
        check_finite(self._law.parameters, self.iteration, "algorithm.step.max_kl or optimizer.lr")
        self.frames += 2 * data.numel()
        self.iteration += 1
        return {
            "train/return": _returns(later),
            "train/return_before": _returns(data),
            "train/episode_length": float(_alive(later).sum(-1).double().mean()),
            "train/failed": _failed(data) + _failed(later),
            "train/kl": taken.kl,
            "train/objective_gain": taken.gain,
            "train/backtracks": float(taken.backtracks),
            "train/moved": float(not taken.reason),
            "train/scale": float(later["scale"].mean()),
            "train/frames": float(self.frames),
        }

    def _collect(self, thetas: Tensor) -> TensorDictBase:
        """Return an episode of each row, (B M, T), under parameters (P,) or (B, P)."""
        self._actor.thetas = thetas.detach()
        return self.collecting.next()

    def _experience(self, operator: PolicyGradient, data: TensorDictBase) -> TransitionBatch:
        """Return steps (B M, T) by task."""

        def by_task(x: Tensor) -> Tensor:
            return x.unflatten(0, (self._tasks, self._each))

        return operator.experience(
            [by_task(x) for x in self._law.read(data)],
            by_task(data["action"]),
            by_task(data["action_log_prob"]),
            by_task(data["next", "reward"][..., 0]),
            by_task(_alive(data)),
        )

    def _improve(self, objective: MetaObjective) -> StepResult:
        """Return where the step leads, and how."""
        start = objective.start
        if isinstance(self._step, NaturalStep):
            product = objective.fisher(self._pick)
            return self._step(start, objective.gradient(), product, objective.assess)
        assert self._optimizer is not None
        settings, slope = self._step, torch.func.grad(objective.clipped)
        for _ in range(settings.epochs):
            found = slope(self._law.vector(), settings.clip_epsilon, settings.kl_weight)
            for p, part in zip(self._law.parameters, self._law.split(-found), strict=True):
                p.grad = part.clone()
            self._optimizer.step()
        found_at, begun = objective.assess(self._law.vector()), objective.assess(start)
        gain = found_at.objective - begun.objective
        return StepResult(self._law.vector(), gain, found_at.kl, 0, "")

    def _pick(self, experience: TransitionBatch) -> TransitionBatch:
        """Take as many steps of each task at random, each as likely."""
        count = max(1, self._states // self._tasks)
        index = torch.multinomial(experience.weight, count, replacement=True)  # (B, n)

        def some(x: Tensor) -> Tensor:
            wide = index.view(*index.shape, *[1] * (x.ndim - 2)).expand(-1, -1, *x.shape[2:])
            return x.gather(1, wide)

        seen = tuple(some(x) for x in experience.seen)
        action, log_prob, advantage = (some(x) for x in experience[1:4])
        weight = torch.full_like(advantage, 1 / count)
        return TransitionBatch(seen, action, log_prob, advantage, weight)

    def adapted(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
        """Return the parameters that the policy adapts to on a robot; None if it does not adapt."""
        adapt = self.parts.adapt
        if not isinstance(adapt, PolicyGradient):
            return None
        return adapt_to(self.trained(), adapt, values[None], rng)[0][0]


def _made(policy: Any) -> Policy:
    if not isinstance(policy, Policy) or policy.critic is not None:
        raise Sim2RealError(
            "algorithm=pg_maml trains only an actor, with a linear baseline; use policy=actor"
        )
    return policy


def _alive(data: TensorDictBase) -> Tensor:
    """Return whether the first episode of each row was going on before a step, (N, T) bool."""
    done = data["next", "done"][..., 0].long()
    return done.cumsum(-1) - done == 0


def _returns(data: TensorDictBase) -> float:
    """Return the mean return of the first episodes, as the task pays it."""
    raw = data.get(("next", "raw_reward"), None)
    reward = data["next", "reward"] if raw is None else raw
    return float((reward[..., 0] * _alive(data)).sum(-1).double().mean())


def _failed(data: TensorDictBase) -> float:
    return float((data["next", "failed"][..., 0] & _alive(data)).sum())
