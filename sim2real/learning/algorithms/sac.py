"""SAC: soft actor-critic with a temperature that is learned (Haarnoja et al. 2018).

    algorithm = SAC(Parts(environment, policy, seed=0), num_rows=8, update_ratio=1.0, ...)
    while algorithm.frames < 300_000:
        metrics = algorithm.iterate()

Every row takes a step, the transitions go into TorchRL's replay buffer, and `update_ratio` gradient
steps follow for each of them. An episode that the time limit cuts off goes on in its value.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torchrl.data import ReplayBuffer, TensorStorage

from envs.rows import Rows
from sim2real.learning.algorithms.base import Algorithm, Parts
from sim2real.learning.algorithms.checks import check_at_least, check_share, refuse_other_policy
from sim2real.learning.algorithms.stream import EpisodeStream
from sim2real.learning.losses.sac_loss import SACGradient, Transitions
from sim2real.learning.modules.soft_actor_critic import SoftActorCritic, draw
from sim2real.learning.trained import Trained, of_module
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class SAC(Algorithm):
    """Trains an actor and two critics on all that was ever seen.

    Args:
        parts: the environment, whose tasks episodes meet, one draw each; the policy, a
            `SoftActorCritic`; the networks' device; the simulation and the replay buffer are on the
            CPU.
        num_rows: N, episodes side by side.
        steps: of each row in an iteration; it decides only how often metrics are written.
        update_ratio: gradient steps for each environment step.
        batch_size: transitions of a gradient step.
        buffer_size: transitions that are kept, the newest.
        warmup_frames: environment steps of random actions before the first gradient step.
        learning_rate: of Adam, for all networks and the temperature.
        gamma: discount of a step.
        tau: how much of the critics goes into the target in a gradient step.
        alpha: first temperature: how much entropy counts.
        target_entropy: of the actor, that the temperature is steered to [nat]; None for minus the
            number of actions.

    Raises:
        Sim2RealError: for values out of range, a policy of another kind, or tasks that the
            environment cannot have.
    """

    def __init__(
        self,
        parts: Parts,
        *,
        num_rows: int,
        steps: int,
        update_ratio: float,
        batch_size: int,
        buffer_size: int,
        warmup_frames: int,
        learning_rate: float,
        gamma: float,
        tau: float,
        alpha: float,
        target_entropy: float | None,
    ) -> None:
        check_at_least(1, num_rows=num_rows, steps=steps, batch_size=batch_size)
        check_at_least(num_rows, buffer_size=buffer_size)
        check_share(gamma=gamma, tau=tau)
        if not (update_ratio > 0 and alpha > 0):
            raise Sim2RealError(
                f"algorithm.update_ratio={update_ratio} and alpha={alpha} must be above 0"
            )
        self.parts, device = parts, parts.device
        rows = parts.environment.rows(num_rows, threads=0)
        worlds, start, self._acting, sampling, self._noise = (
            np.random.default_rng(s) for s in np.random.SeedSequence(parts.seed).spawn(5)
        )
        self.stream = EpisodeStream(rows, parts.tasks, worlds)
        self.policy = _make_policy(parts, start)
        self._device = torch.device(device)
        self._steps, self._ratio, self._batch = steps, update_ratio, batch_size
        self._warmup, self._tau = warmup_frames, tau
        self.log_alpha = torch.full((), float(np.log(alpha)), device=device, requires_grad=True)
        entropy = -rows.action_size if target_entropy is None else target_entropy
        self._gradient = SACGradient(self.policy, gamma, float(entropy))
        parameters = [self.policy.actor_theta, self.policy.critic_theta, self.log_alpha]
        self._optimizer = torch.optim.Adam(parameters, lr=learning_rate, fused=True)
        self._replay = make_replay(rows, buffer_size, sampling)
        self._middle = (rows.action_high + rows.action_low) / 2
        self._half = (rows.action_high - rows.action_low) / 2
        self.frames = self.iteration = self.updates = 0

    @property
    def shape(self) -> dict[str, Any]:
        """The networks' sizes and nonlinearity."""
        return dict(self.policy.shape)

    def trained(self) -> Trained:
        """Return the deterministic actor."""
        return of_module(self.policy.actor(), self.parts.environment, self.frames)

    def iterate(self) -> dict[str, float]:
        """Step and learn in turns."""
        for _ in range(self._steps):
            self._step()
            due = self._ratio * (self.stream.frames - self._warmup) - self.updates
            self._learn(int(due + 1e-9))
        self.frames = self.stream.frames
        self.iteration += 1
        return {
            **self.stream.summary(),
            "train/alpha": float(self.log_alpha.detach().exp()),
            "train/updates": float(self.updates),
            "train/failed": float(self.stream.failures),
            "train/frames": float(self.frames),
        }

    @torch.no_grad()
    def _step(self) -> None:
        """Take a step in every row and remember it."""
        seen = torch.from_numpy(self.stream.observation).to(torch.float32)
        action = self._act(seen)  # (N, A), in (-1, 1)
        step = self.stream.step((self._middle + self._half * action.numpy()).astype(np.float32))
        after = (step.reward, step.observation, step.terminated)
        reward, observation, terminated = (
            torch.from_numpy(x).to(torch.float32, copy=True) for x in after
        )
        values = Transitions(seen, action, reward, observation, terminated)
        self._replay.extend(TensorDict(values._asdict(), [len(action)]))

    def _act(self, seen: Tensor) -> Tensor:
        shape = (len(seen), self.stream.rows.action_size)
        if self.stream.frames < self._warmup:
            return torch.from_numpy(self._acting.uniform(-1, 1, shape).astype(np.float32))
        noise = torch.from_numpy(self._acting.standard_normal(shape, dtype=np.float32))
        said = self.policy.distribution(seen.to(self._device))
        return draw(said, noise.to(self._device)).action.cpu()

    def _learn(self, count: int) -> None:
        """Take gradient steps."""
        if count < 1:
            return
        drawn = self._replay.sample(count * self._batch).to(self._device)
        parts = [drawn[name].split(self._batch) for name in Transitions._fields]
        shape = (count, 2, self._batch, self.stream.rows.action_size)
        noise = torch.from_numpy(self._noise.standard_normal(shape, dtype=np.float32))
        for (own, following), *batch in zip(noise.to(self._device), *parts, strict=True):
            alpha = self.log_alpha.detach().exp()
            self.log_alpha.grad = self._gradient(Transitions(*batch), own, following, alpha)
            self._optimizer.step()
            with torch.no_grad():
                self.policy.target.lerp_(self.policy.critic_theta, self._tau)
        self.updates += count

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on."""
        kept = self._replay.storage[: len(self._replay)]
        return {
            "policy": self.policy.shape,
            "networks": {k: v.clone() for k, v in self.policy.state_dict().items()},
            "log_alpha": self.log_alpha.detach().clone(),
            "optimizer": deepcopy(self._optimizer.state_dict()),
            "replay": {name: kept[name].clone() for name in Transitions._fields},
            "writer": dict(self._replay.writer.state_dict()),
            "sampling": self._replay._rng.get_state(),
            "stream": self.stream.state_dict(),
            "acting": self._acting.bit_generator.state,
            "noise": self._noise.bit_generator.state,
            "counts": (self.iteration, self.updates),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned.

        Raises:
            CheckpointError: for a state of another policy or other rows.
        """
        self.stream.refuse_other_rows(state["stream"])
        self.load_policy(state)
        with torch.no_grad():
            self.log_alpha.copy_(state["log_alpha"])
        self._optimizer.load_state_dict(deepcopy(state["optimizer"]))
        self._replay.empty()
        kept = TensorDict(dict(state["replay"]), [len(state["replay"]["reward"])])
        if len(kept):
            self._replay.extend(kept)
        self._replay.writer.load_state_dict(state["writer"])
        self._replay._rng.set_state(state["sampling"])
        self.stream.load_state_dict(state["stream"])
        self._acting.bit_generator.state = state["acting"]
        self._noise.bit_generator.state = state["noise"]

    def load_policy(self, state: dict[str, Any]) -> None:
        """Take over the networks alone, to act and not to go on training.

        Raises:
            CheckpointError: for a state of another policy.
        """
        refuse_other_policy(state["policy"], self.policy.shape)
        self.policy.load_state_dict(state["networks"])
        self.iteration, self.updates = state["counts"]
        self.frames = state["stream"]["counts"][1]


def make_replay(rows: Rows, capacity: int, rng: np.random.Generator) -> ReplayBuffer:
    """Return an empty replay buffer of transitions that draws by a generator of its own."""
    seen, acted = (rows.observation_size,), (rows.action_size,)
    shapes = Transitions(seen, acted, (), seen, ())  # type: ignore[arg-type]
    empty = {name: torch.zeros(capacity, *shape) for name, shape in shapes._asdict().items()}
    storage = TensorStorage(TensorDict(empty, [capacity]))
    storage._len = 0  # it takes what it is made of for full
    generator = torch.Generator().manual_seed(int(rng.integers(2**63)))
    return ReplayBuffer(storage=storage, generator=generator)


def _make_policy(parts: Parts, rng: np.random.Generator) -> SoftActorCritic:
    """Make and initialize the networks; raises Sim2RealError for another kind."""
    made = parts.policy(parts.environment.make(1, threads=1))
    if not isinstance(made, SoftActorCritic):
        raise Sim2RealError(
            f"algorithm=sac trains an actor and two critics, {type(made).__name__} is none; "
            "use policy=soft_actor_critic"
        )
    made.initialize(torch.Generator().manual_seed(int(rng.integers(2**63))))
    return made.to(parts.device)
