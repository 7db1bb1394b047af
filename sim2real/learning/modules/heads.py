"""Heads, which turn a network's output into the parameters of a distribution."""

import torch
from torch import nn

Tensor = torch.Tensor


class NormalHead(nn.Module):
    """Splits numbers into means and standard deviations, whose logarithms are cut at two limits.

    Args:
        log_std_min: least logarithm of a deviation. The defaults are those of Stable-Baselines3's
            SAC.
        log_std_max: largest one.
    """

    def __init__(self, log_std_min: float = -20.0, log_std_max: float = 2.0) -> None:
        super().__init__()
        self.log_std_min, self.log_std_max = log_std_min, log_std_max

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Map (..., 2 A) to means and deviations, (..., A) each."""
        mean, log_std = x.chunk(2, dim=-1)
        return mean, log_std.clamp(self.log_std_min, self.log_std_max).exp()
