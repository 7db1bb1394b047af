"""A student learns to estimate the robot's parameters for a teacher that knows them.

    algorithm = Distill(parts, teacher=partial(load_policy, RUN), num_rows=32, ...)
    algorithm.iterate()         # episodes with the student's guesses, then regression
    algorithm.trained()         # the teacher's policy, given the student's estimates

The second phase of RMA (Kumar et al. 2021): the teacher's policy acts on the student's estimates,
so that the student learns from the states that its own estimates lead to. Its targets are the true
parameters, normalized as the teacher receives them.
"""

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torchrl.envs.utils import ExplorationType, set_exploration_type

from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.algorithms.checks import check_at_least, check_positive
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.student import EstimateContext, Student, moments
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class Distill(Algorithm):
    """Trains a student by regression on rollouts.

    Args:
        parts: the teacher's environment takes the place of theirs.
        teacher: makes the policy that receives its robot's parameters.
        num_rows: episodes of an iteration.
        history: number of past steps that the student observes.
        hidden: widths of its hidden layers.
        learning_rate: of Adam.
        epochs: epochs over the steps of an iteration.
        batch_size: steps of a gradient step.

    Raises:
        Sim2RealError: numbers out of range, or a teacher that receives no parameters.
    """

    def __init__(
        self,
        parts: Components,
        *,
        teacher: Callable[[], TrainedPolicy],
        num_rows: int,
        history: int,
        hidden: Sequence[int],
        learning_rate: float,
        epochs: int,
        batch_size: int,
    ) -> None:
        check_at_least(1, num_rows=num_rows, epochs=epochs, batch_size=batch_size)
        check_positive(learning_rate=learning_rate)
        self._teacher = teacher()
        context, own = self._teacher.context, self._teacher.environment
        if own.name != parts.environment.name:
            raise Sim2RealError(
                f"algorithm.teacher is a policy of {own.name}, but env is "
                f"{parts.environment.name}; give the teacher's env"
            )
        if context is None:
            raise Sim2RealError(
                "algorithm.teacher: this policy receives no parameters, so a student has nothing "
                "to estimate; give the run of one with transforms=with_params"
            )
        size, low, _ = self._teacher.environment.observation_and_action_spec()
        with TorchRandomStream(parts.seed, "cpu"):
            self.student = Student(size, len(low), context.size, history, tuple(hidden))
        self.parts = replace(parts, environment=own.with_estimated_context(self.student))
        self._optimizer = torch.optim.Adam(self.student.parameters(), lr=learning_rate)
        self._num_rows, self._epochs, self._batch_size = num_rows, epochs, batch_size
        self._rng = np.random.default_rng(parts.seed)
        self.frames = self.iteration = 0

    @property
    def shape(self) -> dict[str, Any]:
        """The student's sizes."""
        return {name: list(p.shape) for name, p in self.student.named_parameters()}

    def trained(self) -> TrainedPolicy:
        """Return the teacher's policy, given the student's estimates."""
        environment = self._teacher.environment.with_estimated_context(deepcopy(self.student))
        return replace(self._teacher, environment=environment, program=None, frames=self.frames)

    def iterate(self) -> dict[str, float]:
        """Run episodes with the student's guesses, and learn from them."""
        past, truth, returns = self._episodes()
        if self.iteration == 0:
            self.student.mean[:], self.student.std[:] = moments(past)
        losses = []
        for _ in range(self._epochs):
            order = torch.from_numpy(self._rng.permutation(len(past)))
            for batch in order.split(self._batch_size):
                loss = (self.student(past[batch]) - truth[batch]).square().mean()
                self._optimizer.zero_grad()
                loss.backward()
                self._optimizer.step()
                losses.append(float(loss.detach()))
        self.frames += len(past)
        self.iteration += 1
        return {
            "train/return": float(returns.mean()),
            "train/loss": float(np.mean(losses)),
            "train/frames": float(self.frames),
        }

    @torch.no_grad()
    def _episodes(self) -> tuple[Tensor, Tensor, np.ndarray]:
        """Return the student's inputs (B, H, W), the targets (B, P) and the returns (N,)."""
        teacher, count, context = self._teacher, self._num_rows, self._teacher.context
        assert context is not None
        env = self.trained().make_env(count)
        chain: Any = env.transform
        (guess,) = [one for one in chain if isinstance(one, EstimateContext)]
        base: Any = env.base_env
        tasks, rows = teacher.environment.tasks, base.rows
        tasks.check(rows.space)
        values, seeds = tasks.sample(self._rng, count), draw_seeds(self._rng, count)
        truth = torch.from_numpy(context.normalize(values, guess.limit)).float()
        actor, alive = teacher.actor(teacher.theta), torch.ones(count, dtype=torch.bool)
        seen, wanted, returns = [], [], np.zeros(count)
        try:
            with set_exploration_type(ExplorationType.DETERMINISTIC):
                now = env.reset(values=values, seeds=seeds)
                while alive.any():
                    seen.append(guess.past[alive].clone())
                    wanted.append(truth[alive])
                    step, now = env.step_and_maybe_reset(actor(now))
                    reward = step["next", "reward"][:, 0].numpy()
                    returns += np.where(alive.numpy(), reward, 0.0)
                    alive = alive & ~step["next", "done"][:, 0]
        finally:
            env.close()
        return torch.cat(seen), torch.cat(wanted), returns

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on, but the teacher."""
        return {
            "student": deepcopy(self.student.state_dict()),
            "optimizer": deepcopy(self._optimizer.state_dict()),
            "rng": self._rng.bit_generator.state,
            "frames": self.frames,
            "iteration": self.iteration,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to a state that `state_dict` returned."""
        self.student.load_state_dict(state["student"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._rng.bit_generator.state = state["rng"]
        self.frames, self.iteration = int(state["frames"]), int(state["iteration"])
