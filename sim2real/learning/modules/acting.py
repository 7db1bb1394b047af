"""Deterministic policies of raw observations: as a torch module, and as TorchRL steps with it."""

from typing import ClassVar, Literal

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import nn

Tensor = torch.Tensor


class Acting(TensorDictModuleBase):
    """Reads "observation" and writes "action".

    It reads and writes by itself: `TensorDictModule` costs more than a small network.

    Args:
        module: maps observations (..., O) to actions (..., A).
    """

    in_keys: ClassVar[list[str]] = ["observation"]
    out_keys: ClassVar[list[str]] = ["action"]

    def __init__(self, module: nn.Module) -> None:
        super().__init__()
        self.module = module

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Add the action to the tensordict."""
        return tensordict.set("action", self.module(tensordict.get("observation")))


class Actor(nn.Module):
    """A network as a policy: raw observation to action, deterministic.

    Args:
        network: maps normalized observations (..., O) to actions (..., A).
        mean: what normalization subtracts from an observation, (O,).
        std: what it divides by, (O,).
        low: the actions' lower limits, (A,).
        high: the actions' upper limits, (A,).
        squash: "clip" cuts actions at the limits, "tanh" squashes into them, "none" leaves them.
    """

    observation_mean: Tensor
    observation_std: Tensor
    action_low: Tensor
    action_high: Tensor

    def __init__(
        self,
        network: nn.Module,
        mean: np.ndarray,
        std: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        squash: Literal["clip", "tanh", "none"] = "clip",
    ) -> None:
        super().__init__()
        self.network, self.squash = network, squash
        constants = {
            "observation_mean": mean,
            "observation_std": std,
            "action_low": low,
            "action_high": high,
        }
        for name, value in constants.items():
            self.register_buffer(name, torch.tensor(np.asarray(value), dtype=torch.float64))

    def forward(self, observation: Tensor) -> Tensor:
        """Map raw observations (..., O) to actions (..., A)."""
        normalized = (observation - self.observation_mean) / self.observation_std
        x = self.network(normalized.to(torch.float32))
        if self.squash == "tanh":
            middle, half = self.action_high + self.action_low, self.action_high - self.action_low
            return ((middle + half * torch.tanh(x)) / 2).to(torch.float32)
        if self.squash == "none":
            return x
        low, high = self.action_low.to(x.dtype), self.action_high.to(x.dtype)
        return torch.minimum(torch.maximum(x, low), high)
