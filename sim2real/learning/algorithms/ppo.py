"""PPO: proximal policy optimization with a clipped objective (Schulman et al. 2017).

    algorithm = PPO(env, tasks, policy, seed=0, device="cpu", num_rows=16, steps=128, ...)
    while algorithm.frames < 500_000:
        metrics = algorithm.iterate()

One iteration takes `steps` steps in each of `num_rows` rows, estimates advantages by TorchRL's
generalized advantage estimator, and goes through the samples in minibatches for some epochs. An
episode that the time limit cuts off goes on in its value; one that the task ends does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch import nn
from torchrl.objectives.value.functional import generalized_advantage_estimate

from envs.randomization import Tasks
from envs.rows import Rows
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.algorithms.esmaml import make_shards
from sim2real.learning.algorithms.experience import Experience, gather
from sim2real.learning.algorithms.reward_scale import RewardScale
from sim2real.learning.algorithms.stream import EpisodeStream
from sim2real.learning.losses.clip_loss import (
    Batch,
    ClipLoss,
    entropy,
    log_prob,
    make_gradient,
)
from sim2real.learning.modules.actor_critic import ActorCritic
from sim2real.learning.modules.conv_actor_critic import ConvActorCritic
from sim2real.learning.modules.gru_actor_critic import GRUActorCritic
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.runs.errors import CheckpointError, Sim2RealError

Tensor = torch.Tensor


class PPO(Algorithm):
    """Trains an actor and a critic on their own experience.

    Args:
        env: makes the environment; see `make_shards`. The tasks' effects are handed to it.
        tasks: which robots episodes meet, one draw each.
        policy: makes the actor and critic from observation_size, action_size, action_low and
            action_high.
        seed: all randomness of the run follows from it.
        device: where the networks are; the simulation runs on the CPU.
        num_rows: N, episodes side by side.
        steps: T, of each row in an iteration.
        epochs: passes over the samples of an iteration.
        minibatch_size: samples of a gradient step.
        learning_rate: of Adam.
        adam_eps: what Adam adds to the root of the second moment.
        anneal_frames: environment steps over which the learning rate falls to 0; None keeps it.
        gamma: discount of a step.
        lmbda: of the advantage estimator: 0 trusts the critic, 1 the returns.
        clip_epsilon: how far the ratio of probabilities may leave 1.
        critic_coeff: weight of the critic's loss.
        entropy_coeff: weight of the entropy.
        max_grad_norm: norm that the gradient is cut to.
        normalize_advantage: whether each minibatch's advantages get mean 0 and deviation 1.
        target_kl: divergence from the policy that acted after which an iteration's epochs end; None
            for no limit.
        normalize_observations: whether networks see observations with the running mean and
            deviation taken out, frozen within an iteration.
        normalize_rewards: whether rewards are divided by the running deviation of the discounted
            return; logged returns are not.

    Raises:
        Sim2RealError: for values out of range, a policy that is no actor and critic, or tasks that
            the environment cannot have.
    """

    def __init__(
        self,
        env: Callable[..., Rows],
        tasks: Tasks,
        policy: Callable[..., ActorCritic | ConvActorCritic],
        seed: int,
        device: str,
        *,
        num_rows: int,
        steps: int,
        epochs: int,
        minibatch_size: int,
        learning_rate: float,
        adam_eps: float,
        anneal_frames: int | None,
        gamma: float,
        lmbda: float,
        clip_epsilon: float,
        critic_coeff: float,
        entropy_coeff: float,
        max_grad_norm: float,
        normalize_advantage: bool,
        target_kl: float | None,
        normalize_observations: bool,
        normalize_rewards: bool,
    ) -> None:
        check_at_least(1, num_rows=num_rows, steps=steps, epochs=epochs)
        check_at_least(1, minibatch_size=minibatch_size)
        check_share(gamma=gamma, lmbda=lmbda)
        if num_rows * steps < minibatch_size:
            raise Sim2RealError(
                f"algorithm.minibatch_size={minibatch_size} is more than the {num_rows * steps} "
                "samples of an iteration (num_rows times steps)"
            )
        worlds, start, acting, sorting = (
            np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)
        )
        self._env, self.tasks = env, tasks
        rows = self.world(num_rows)
        self.stream = EpisodeStream(rows, tasks, worlds)
        self.policy = make_policy(policy, rows, start, device)
        self._window, self._memory = 1, None
        if isinstance(self.policy, GRUActorCritic):
            self._window = self.policy.window
            self._memory = torch.zeros(num_rows, self.policy.memory, device=device)
        if steps % self._window:
            raise Sim2RealError(
                f"policy.window={self._window} does not divide algorithm.steps={steps}"
            )
        self._acting, self._sorting = acting, sorting
        self._steps, self._epochs, self._minibatch = steps, epochs, minibatch_size
        self._rate, self._anneal = learning_rate, anneal_frames
        self._gamma, self._lmbda = gamma, lmbda
        self._max_norm, self._target_kl = max_grad_norm, target_kl
        self._loss = ClipLoss(clip_epsilon, critic_coeff, entropy_coeff, normalize_advantage)
        self._gradient = make_gradient(self.policy, self._loss)
        self._optimizer = torch.optim.Adam(
            [self.policy.theta], lr=learning_rate, eps=adam_eps, fused=True
        )
        size = rows.observation_size
        self.normalizer = Normalizer(size) if normalize_observations else None
        self._reward_scale = RewardScale(num_rows, gamma) if normalize_rewards else None
        self.frames = self.iteration = 0

    def world(self, num_rows: int) -> Rows:
        """Make rows of what it trains in, stepped by all cores."""
        return make_shards(self._env, num_rows, 1, self.tasks.effects, threads=0)[0]

    def module(self) -> nn.Module:
        """Return the deterministic policy of raw observations."""
        seen = self.normalizer or Normalizer(self.stream.rows.observation_size)
        return self.policy.actor(seen.mean, seen.std)

    def iterate(self) -> dict[str, float]:
        """Gather experience and learn from it."""
        experience = gather(
            self.stream, self.policy, self._steps, self._acting, self.normalizer, self._memory
        )
        batch = self._prepare(experience)
        epochs = self._learn(batch)
        if self.normalizer is not None:
            _note(self.normalizer, experience.raw)
        self.frames = self.stream.frames
        self.iteration += 1
        return {
            **self.stream.summary(),
            **self._assess(batch),
            "train/epochs": float(epochs),
            "train/failed": float(self.stream.failures),
            "train/frames": float(self.frames),
        }

    @torch.no_grad()
    def _prepare(self, experience: Experience) -> Batch:
        """Return the samples of an iteration with their advantages, (T N, ...)."""
        reward = experience.reward
        if self._reward_scale is not None:
            reward = self._reward_scale(reward, experience.over)
        seen = experience.observation
        mean, log_std, value = self.policy(seen.flatten(0, 1))
        value = value.view(seen.shape[:2])  # (T + 1, N)
        after = value[1:].clone()
        if len(experience.cut):  # the time limit ended these, not the task
            after[experience.cut_at] = self.policy(experience.cut)[2]
        advantage, target = generalized_advantage_estimate(
            self._gamma,
            self._lmbda,
            *(_columns(x) for x in (value[:-1], after)),
            *(_columns(torch.from_numpy(x).to(value)) for x in (reward,)),
            *(_columns(torch.from_numpy(x).to(value.device)) for x in experience.ends),
        )
        flat = [x[..., 0].T.flatten() for x in (advantage, target)]
        action = experience.action.flatten(0, 1)
        probability = log_prob(action, mean[: len(action)], log_std)
        return self._windows(Batch(seen[:-1].flatten(0, 1), action, probability, *flat))

    def _windows(self, batch: Batch) -> Batch:
        """Return samples (T N, ...) as windows (S, L, ...) for a policy that learns from those."""
        if self._memory is None:
            return batch
        lead = (self._steps // self._window, self._window, len(self._memory))
        cut = [x.view(*lead, *x.shape[1:]).transpose(1, 2).flatten(0, 1) for x in batch]
        return Batch(*(x.contiguous() for x in cut))

    def _learn(self, batch: Batch) -> int:
        """Go through the samples; return the epochs done."""
        rate = self._rate
        if self._anneal is not None:
            rate *= max(0.0, 1.0 - self.frames / self._anneal)
        self._optimizer.param_groups[0]["lr"] = rate
        for epoch in range(self._epochs):
            order = torch.from_numpy(self._sorting.permutation(len(batch.target)))
            size = max(1, self._minibatch // self._window)
            shuffled = [x[order.to(x.device)].split(size) for x in batch]
            for parts in zip(*shuffled, strict=True):
                self._gradient(Batch(*parts))
                clip_norm(self.policy.theta.grad, self._max_norm)
                self._optimizer.step()
            if self._target_kl is not None and self._divergence(batch)[0] > self._target_kl:
                return epoch + 1
        return self._epochs

    @torch.no_grad()
    def _divergence(self, batch: Batch) -> tuple[float, float]:
        """Return how far the policy has moved: KL divergence [nat] and share of clipped ratios."""
        mean, log_std, _ = self.policy(batch.observation)
        change = log_prob(batch.action, mean, log_std) - batch.log_prob
        ratio = torch.exp(change)
        clipped = (ratio - 1).abs() > self._loss.clip_epsilon
        return float((ratio - 1 - change).mean()), float(clipped.float().mean())

    @torch.no_grad()
    def _assess(self, batch: Batch) -> dict[str, float]:
        divergence, clipped = self._divergence(batch)
        value = batch.target - batch.advantage  # what the critic said before this iteration
        left = torch.var(batch.advantage) / torch.var(batch.target)
        return {
            "train/kl": divergence,
            "train/clip_fraction": clipped,
            "train/entropy": float(entropy(self.policy.present.log_std)),
            "train/value": float(value.mean()),
            "train/explained_variance": 1.0 - float(left),
            "train/learning_rate": float(self._optimizer.param_groups[0]["lr"]),
        }

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on."""
        parts = {"normalizer": self.normalizer, "reward_scale": self._reward_scale}
        return {
            "policy": self.policy.shape,
            "theta": self.policy.theta.detach().clone(),
            "optimizer": deepcopy(self._optimizer.state_dict()),
            **{name: None if p is None else p.state_dict() for name, p in parts.items()},
            "memory": None if self._memory is None else self._memory.clone(),
            "stream": self.stream.state_dict(),
            "acting": self._acting.bit_generator.state,
            "sorting": self._sorting.bit_generator.state,
            "iteration": self.iteration,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned.

        Raises:
            CheckpointError: for a state of another policy, another normalization or other rows.
        """
        self.stream.refuse_other_rows(state["stream"])
        self.load_policy(state)
        _load_part("reward_scale", self._reward_scale, state)
        if self._memory is not None:
            self._memory.copy_(state["memory"])
        self._optimizer.load_state_dict(deepcopy(state["optimizer"]))
        self.stream.load_state_dict(state["stream"])
        self._acting.bit_generator.state = state["acting"]
        self._sorting.bit_generator.state = state["sorting"]

    def load_policy(self, state: dict[str, Any]) -> None:
        """Take over the policy alone, to act and not to go on training.

        Raises:
            CheckpointError: for a state of another policy or another normalization.
        """
        refuse_other_policy(state["policy"], self.policy.shape)
        _load_part("normalizer", self.normalizer, state)
        with torch.no_grad():
            self.policy.theta.copy_(state["theta"])
        self.frames, self.iteration = state["stream"]["counts"][1], int(state["iteration"])


def _load_part(name: str, part: Normalizer | RewardScale | None, state: dict[str, Any]) -> None:
    if (state[name] is None) != (part is None):
        raise CheckpointError(
            f"checkpoint: the {name} differs between the checkpoint and this run; set "
            "algorithm.normalize_observations and normalize_rewards as they were"
        )
    if part is not None:
        part.load_state_dict(state[name])


def make_policy(
    policy: Callable[..., Any], rows: Rows, rng: np.random.Generator, device: str
) -> ActorCritic | ConvActorCritic:
    """Make and initialize the actor and critic for rows.

    Raises:
        Sim2RealError: for a policy of another kind.
    """
    made = policy(
        observation_size=rows.observation_size,
        action_size=rows.action_size,
        action_low=rows.action_low,
        action_high=rows.action_high,
    )
    if not isinstance(made, ActorCritic | ConvActorCritic):
        raise Sim2RealError(
            f"algorithm=ppo trains an actor and a critic, {type(made).__name__} is none; "
            "use policy=actor_critic or policy=gru, or policy=cnn for images"
        )
    made.initialize(torch.Generator().manual_seed(int(rng.integers(2**63))))
    return made.to(device)


def clip_norm(gradient: Tensor | None, limit: float) -> None:
    """Shorten a flat gradient (P,) to a norm, as `torch.nn.utils.clip_grad_norm_` does."""
    assert gradient is not None
    gradient.mul_((limit / (gradient.norm() + 1e-6)).clamp_(max=1.0))


def _columns(x: Tensor) -> Tensor:
    """Turn (T, N) into what TorchRL's estimator wants, (N, T, 1)."""
    return x.T.unsqueeze(-1)


def _note(normalizer: Normalizer, raw: np.ndarray) -> None:
    """Add raw observations (T, N, O) to what a normalizer has seen."""
    off = raw.reshape(-1, raw.shape[-1]) - normalizer.mean
    normalizer.update(len(off), off.sum(axis=0), np.square(off).sum(axis=0))


def refuse_other_policy(there: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    """Raise CheckpointError where a checkpoint's policy has another shape than this run's."""
    if dict(there) != dict(here):
        raise CheckpointError(
            f"checkpoint: its policy is {dict(there)}, this run's is {dict(here)}; give the run "
            "the checkpoint's env and policy"
        )


def check_at_least(least: int, **counts: int) -> None:
    """Raise Sim2RealError for options below what they must be."""
    for name, value in counts.items():
        if value < least:
            raise Sim2RealError(f"algorithm.{name}={value} must be at least {least}")


def check_share(**shares: float) -> None:
    """Raise Sim2RealError for options that are not between 0 and 1."""
    for name, value in shares.items():
        if not 0 <= value <= 1:
            raise Sim2RealError(f"algorithm.{name}={value} must be between 0 and 1")
