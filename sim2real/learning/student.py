"""A student of a policy that knows its robot: it estimates the parameters from past steps.

    student = Student(observation_size=11, action_size=3, parameters=2, history=50, hidden=(128,
    64)) student(past)                               # (N, P) of (N, history, O + A): -1 to 1

After RMA (Kumar et al. 2021, "RMA: rapid motor adaptation for legged robots"), whose student sees
the last steps, too, and says what the policy wants to know of its robot; here that are the
parameters themselves. No episode is spent on adapting and nothing is simulated on the robot.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import nn

from sim2real.learning.context import AppendContext, ContextSpec
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class Student(nn.Module):
    """A perceptron from the last steps to a robot's normalized parameters.

    Args:
        observation_size: O, numbers that the robot shows.
        action_size: A.
        parameters: P.
        history: H, steps that it sees.
        hidden: widths of the hidden layers.

    Raises:
        Sim2RealError: no step to see.
    """

    mean: Tensor
    std: Tensor

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        parameters: int,
        history: int,
        hidden: Sequence[int],
    ) -> None:
        if history < 1:
            raise Sim2RealError(f"algorithm.history={history} must be at least 1")
        super().__init__()
        self.history, self.width = history, observation_size + action_size
        sizes = [history * self.width, *hidden]
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layers += [nn.Linear(inputs, outputs), nn.Tanh()]
        self.network = nn.Sequential(*layers, nn.Linear(sizes[-1], parameters), nn.Tanh())
        self.register_buffer("mean", torch.zeros(self.width))
        self.register_buffer("std", torch.ones(self.width))

    def forward(self, past: Tensor) -> Tensor:
        """Return guesses (..., P) from steps (..., H, O + A), the oldest first; NaN: none yet."""
        seen = ((past - self.mean) / self.std).nan_to_num(0.0)
        return self.network(seen.flatten(-2))


class EstimateContext(AppendContext):
    """Appends what a student guesses of the robot to "observation".

    Args:
        context: which parameters, and over which ranges.
        student: guesses them.
        limit: see `AppendContext`.
        products: see `AppendContext`.

    Attributes:
        past: what the student saw last, (N, H, O + A), the oldest step first; NaN before the
            episode.
    """

    def __init__(
        self, context: ContextSpec, student: Student, limit: float = 1.0, products: bool = False
    ) -> None:
        super().__init__(context, limit, products)
        self.student = [student]  # no submodule: its state is that of who trains it
        self.past = torch.empty(0)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get("action").to(self.past)
        self._push(next_tensordict.get("observation"), action)
        return self._call(next_tensordict)

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        seen = tensordict_reset.get("observation")
        began = None if tensordict is None else tensordict.get("_reset", None)
        student, count = self.student[0], seen.shape[0]
        if began is None or len(self.past) != count:
            self.past = torch.full((count, student.history, student.width), torch.nan)
            rows = torch.ones(count, dtype=torch.bool)
        else:
            rows = began.reshape(-1).cpu()
        kept = self.past.clone()
        self.past[rows] = torch.nan
        self._push(seen, torch.zeros(count, student.width - seen.shape[-1]))
        self.past[~rows] = kept[~rows]
        return self._call(tensordict_reset)

    def _push(self, seen: Tensor, action: Tensor) -> None:
        newest = torch.cat([seen.to(self.past), action.to(self.past)], -1)
        self.past = torch.cat([self.past[:, 1:], newest[:, None]], 1)

    @torch.no_grad()
    def _said(self, tensordict: TensorDictBase, seen: Tensor) -> Tensor:
        if self.assumed_context is not None:
            return super()._said(tensordict, seen)
        return self.student[0](self.past)


def moments(past: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and deviation of steps (B, H, W), each (W,); 0 and 1 where nothing varies."""
    steps = past.flatten(0, -2).double().numpy()
    mean, std = np.nanmean(steps, axis=0), np.nanstd(steps, axis=0)
    std = np.where(std > 0, std, 1.0)
    return torch.from_numpy(mean).float(), torch.from_numpy(std).float()
