"""Advantages over a linear baseline that is fitted to the same episodes.

    judge = LinearGAE(gamma=0.99, lmbda=1.0, ridge=1e-5)
    advantage = judge(observation, reward, alive)       # (..., M, T), mean 0 and deviation 1

After Duan et al. 2016, "Benchmarking deep reinforcement learning for continuous control", section
4: the value is linear in the observation, its square and the first powers of time. All episodes are
whole or end at step T, where nothing follows; so a policy that has a few of them needs no critic.
"""

from dataclasses import dataclass

import torch

from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
TIME_UNIT = 100.0  # steps that the powers of time count in
TINY = 1e-8  # added to the deviation that advantages are divided by


@dataclass(frozen=True, kw_only=True)
class LinearGAE:
    """Generalized advantages (Schulman et al. 2016), a baseline for each task.

    Raises:
        Sim2RealError: for values out of range.
    """

    gamma: float  # discount of a step
    lmbda: float  # 0 trusts the baseline, 1 the returns
    ridge: float  # what is added to the diagonal of the baseline's normal equations

    def __post_init__(self) -> None:
        if not 0 <= self.gamma <= 1 or not 0 <= self.lmbda <= 1 or not self.ridge > 0:
            raise Sim2RealError(
                f"adapt.advantage: gamma={self.gamma} and lmbda={self.lmbda} must be between 0 and "
                f"1, ridge={self.ridge} above 0"
            )

    def __call__(self, observation: Tensor, reward: Tensor, alive: Tensor) -> Tensor:
        """Return advantages (..., M, T), 0 after an episode's end.

        Args:
            observation: (..., M, T, O); each index of the leading dimensions is a task.
            reward: (..., M, T).
            alive: whether the episode was going on before the step, (..., M, T) bool.
        """
        mask = alive.to(torch.float64)
        reward = reward.to(torch.float64) * mask
        value = self._values(observation.to(torch.float64), reward, mask)  # (..., M, T)
        after = torch.cat([value[..., 1:], torch.zeros_like(value[..., :1])], -1)
        error = reward + self.gamma * after - value
        advantage = discounted(error, self.gamma * self.lmbda) * mask
        count = mask.sum((-2, -1), keepdim=True)
        centred = (advantage - advantage.sum((-2, -1), keepdim=True) / count) * mask
        deviation = (centred.square().sum((-2, -1), keepdim=True) / count).sqrt()
        return (centred / (deviation + TINY)).to(observation.dtype)

    def _values(self, observation: Tensor, reward: Tensor, mask: Tensor) -> Tensor:
        """Return the fitted values, (..., M, T), 0 after an episode's end."""
        steps = reward.shape[-1]
        time = torch.arange(steps, dtype=reward.dtype, device=reward.device) / TIME_UNIT
        powers = torch.stack([torch.ones_like(time), time, time**2, time**3], -1)  # (T, 4)
        powers = powers.expand(*reward.shape, 4)
        features = torch.cat([observation, observation.square(), powers], -1) * mask[..., None]
        flat = features.flatten(-3, -2)  # (..., M T, F)
        returns = (discounted(reward, self.gamma) * mask).flatten(-2)[..., None]
        eye = torch.eye(flat.shape[-1], dtype=flat.dtype, device=flat.device)
        gram = flat.mT @ flat + self.ridge * eye
        weights = torch.linalg.lstsq(gram, flat.mT @ returns).solution  # (..., F, 1)
        return (flat @ weights)[..., 0].unflatten(-1, reward.shape[-2:])


def discounted(x: Tensor, gamma: float) -> Tensor:
    """Return sum_k gamma^k x[t + k] of series (..., T)."""
    steps = x.shape[-1]
    apart = torch.arange(steps, dtype=x.dtype, device=x.device)
    lag = apart[:, None] - apart  # (T, T), of the later step behind the earlier
    return x @ torch.where(lag >= 0, gamma ** lag.clamp_min(0), torch.zeros_like(lag))
