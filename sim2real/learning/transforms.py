"""Transforms of environments: running normalization of observations and rewards.

    env = TransformedEnv(base, Compose(RunningNorm(), RewardScaling(gamma=0.99)))
    env.transform.eval()                        # statistics stay as they are, rewards unscaled
    env.transform.load_state_dict(state)        # those of a checkpoint

TorchRL's `VecNormV2` keeps means for each row of a batched environment, in float32, of squares: it
cancels where a mean is far from 0. These keep one mean for all rows, by the parallel update of Chan
et al. 1979, in float64.
"""

from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.data import Composite, Unbounded
from torchrl.envs import (
    ActionScaling,
    InitTracker,
    RewardSum,
    StepCounter,
    TensorDictPrimer,
    Transform,
    TransformedEnv,
)

from envs.torch_env import RandomizeParams
from sim2real.learning.context import AppendContext
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class RunningMeanStd:
    """Mean and variance of everything seen so far; see the module's text.

    Args:
        decay: how much of the past remains after each update; 1 keeps all of it.
    """

    def __init__(self, decay: float) -> None:
        self.decay = decay
        self.count = 0.0
        self.mean = self.squares = torch.zeros((), dtype=torch.float64)

    def update(self, x: Tensor) -> None:
        """Take rows (n, ...) into account."""
        x = x.to(torch.float64)
        if self.count == 0:
            self.mean = self.squares = torch.zeros(x.shape[1:], dtype=x.dtype, device=x.device)
        n, past = len(x), self.count * self.decay
        total = past + n
        off = x - self.mean
        shift = off.mean(0)
        within = off.square().sum(0) - n * shift.square()
        between = shift.square() * (past * n / total)
        self.squares = self.squares * self.decay + within.clamp_min(0) + between
        self.mean = self.mean + shift * (n / total)
        self.count = total

    @property
    def std(self) -> Tensor:
        """Standard deviation; 1 where nothing has varied yet."""
        if self.count == 0:
            return torch.ones_like(self.mean)
        std = (self.squares / self.count).sqrt()
        return torch.where(std > 0, std, torch.ones_like(std))

    def state(self) -> dict[str, Any]:
        """Return everything that was seen."""
        return {"count": self.count, "mean": self.mean.clone(), "squares": self.squares.clone()}

    def load(self, state: dict[str, Any]) -> None:
        """Take over a state that `state` returned."""
        self.count = float(state["count"])
        self.mean, self.squares = state["mean"].clone(), state["squares"].clone()


def to_device(device: torch.device, tensors: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Return two tensors on a device."""
    return tensors[0].to(device), tensors[1].to(device)


BLIND = (  # what they do is not to what is seen
    RandomizeParams,
    StepCounter,
    RewardSum,
    InitTracker,
    TensorDictPrimer,
    ActionScaling,
)


def affine(env: TransformedEnv) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the offset and the scale that transforms apply to "observation", (O + P,) each.

    The environment's own numbers are followed by the robot's parameters, each in its unit, if the
    policy receives them; their clipping is left out. None if the transforms change the observation
    in any other way.
    """
    size = env.base_env.full_observation_spec["observation"].shape[-1]
    mean, std = np.zeros(size), np.ones(size)
    chain: Any = env.transform
    for one in chain.transforms:
        if isinstance(one, RunningNorm) and one.in_keys == ["observation"]:
            found = [np.broadcast_to(x.cpu().numpy(), len(mean)) for x in one.affine()]
            mean, std = mean + std * found[0], std * found[1]
        elif isinstance(one, AppendContext) and not one.products:
            middle, half = one.affine()
            mean, std = np.concatenate([mean, middle]), np.concatenate([std, half])
        elif not isinstance(one, (*BLIND, RewardScaling)):
            return None
    return mean, std


def reward_scale(env: TransformedEnv) -> float:
    """Return the divisor of rewards in training; 1 if no transform scales them."""
    unit, chain = 1.0, env.transform
    for one in getattr(chain, "transforms", ()):
        if isinstance(one, RewardScaling):
            unit *= float(one.moments.std)
    return unit


class RunningNorm(Transform):
    """Takes the running mean and deviation out of an entry, and cuts what is far off.

    Args:
        in_keys: the entries; one mean and deviation for each number of each.
        decay: how much of the past remains after each step; 1 keeps all of it.
        limit: deviations beyond which an entry is cut.
        hold: steps for which the mean and deviation that are applied stay the same; with the length
            of a batch, all that is acted on in it has one normalization. What follows its last step
            is where the next batch begins, and has that one's. Entries pass as they are until then.
            1 renews them at each step.

    In evaluation mode (`eval()`) the statistics stay as they are, and the newest are applied.

    Raises:
        Sim2RealError: for a decay, a limit or a hold out of its range.
    """

    def __init__(
        self,
        in_keys: list[str] | None = None,
        decay: float = 1.0,
        limit: float = 10.0,
        hold: int = 1,
    ) -> None:
        keys = in_keys or ["observation"]
        if not 0 < decay <= 1 or not limit > 0 or hold < 1:
            raise Sim2RealError(
                f"transforms: decay={decay} must be above 0 and at most 1, limit={limit} above 0,"
                f" hold={hold} at least 1"
            )
        super().__init__(in_keys=keys, out_keys=keys)
        self.limit, self.hold = limit, hold
        self.moments = {key: RunningMeanStd(decay) for key in keys}
        self._steps = 0
        self._held: dict[str, tuple[Tensor, Tensor]] = {}  # applied while training
        self._newest: dict[str, tuple[Tensor, Tensor]] = {}  # applied in evaluation

    def affine(self, key: str = "observation") -> tuple[Tensor, Tensor]:
        """Return the offset and the scale applied to an entry: (value - offset) / scale."""
        return self.moments[key].mean, self.moments[key].std

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        self._steps += self.training
        return super()._step(tensordict, next_tensordict)

    def _call(
        self, next_tensordict: TensorDictBase, began: torch.Tensor | None = None
    ) -> TensorDictBase:
        for key, moments in self.moments.items():
            x = next_tensordict.get(key)
            if self.training:
                rows = x.reshape(-1, x.shape[-1])
                moments.update(rows if began is None else rows[began.reshape(-1)])
                self._newest.pop(key, None)
            mean, std = self._applied(key, x)
            scaled = ((x.to(mean.dtype) - mean) / std).clamp_(-self.limit, self.limit)
            next_tensordict.set(key, scaled.to(torch.float32))
        return next_tensordict

    def _applied(self, key: str, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean and the deviation that an entry `x` is normalized with now."""
        if self.training and self.hold > 1:
            if self._steps and self._steps % self.hold == 0:
                self._held[key] = self.affine(key)
            elif key not in self._held:
                like = torch.zeros(x.shape[-1:], dtype=torch.float64)
                self._held[key] = like, torch.ones_like(like)
            mean, std = self._held[key] = to_device(x.device, self._held[key])
            return mean, std
        if key not in self._newest:
            self._newest[key] = to_device(x.device, self.affine(key))
        return self._newest[key]

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        # Rows that go on were counted when they stepped.
        began = None if tensordict is None else tensordict.get("_reset", None)
        return self._call(tensordict_reset, began)

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Return the specs with the entries' new type and limits."""
        for key in self.in_keys:
            old = observation_spec[key]
            observation_spec[key] = Unbounded(old.shape, dtype=torch.float32, device=old.device)
        return observation_spec

    def get_extra_state(self) -> dict[str, Any]:
        """Return the running statistics, and those that are applied."""
        seen = {key: one.state() for key, one in self.moments.items()}
        return {**seen, "steps": self._steps, "held": dict(self._held)}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore the statistics seen and the statistics applied."""
        for key, one in self.moments.items():
            one.load(state[key])
        self._steps, self._held = state["steps"], dict(state["held"])
        self._newest.clear()


class RewardScaling(Transform):
    """Divides rewards by the running deviation of each row's discounted return.

    So one learning rate fits tasks of any reward scale. The mean stays, since it carries the
    objective.

    Args:
        gamma: discount of a step.
        limit: the largest absolute value of a scaled reward.

    Rewards as they were stay under "raw_reward". In evaluation mode (`eval()`) they are not scaled.
    """

    def __init__(self, gamma: float, limit: float = 10.0) -> None:
        super().__init__(in_keys=["reward"], out_keys=["reward", "raw_reward"])
        self.gamma, self.limit = gamma, limit
        self.moments = RunningMeanStd(1.0)
        self._running: Tensor | None = None  # (N, 1)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        reward = next_tensordict.get("reward")
        next_tensordict.set("raw_reward", reward)
        if not self.training:
            return next_tensordict
        before = self._running
        if before is None or before.shape != reward.shape:
            before = torch.zeros_like(reward, dtype=torch.float64)
        returns = before * self.gamma + reward
        self.moments.update(returns.reshape(-1))
        self._running = torch.where(next_tensordict.get("done"), 0.0, returns)
        scaled = (reward / self.moments.std.to(reward.device)).clamp_(-self.limit, self.limit)
        return next_tensordict.set("reward", scaled.to(reward.dtype))

    def _reset(
        self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase
    ) -> TensorDictBase:
        like = tensordict_reset.get("done")
        return tensordict_reset.set("raw_reward", torch.zeros_like(like, dtype=torch.float32))

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Return the specs with the rewards as they were."""
        parent = self.parent
        assert parent is not None  # specs are an environment's
        reward = parent.full_reward_spec["reward"]
        observation_spec["raw_reward"] = Unbounded(
            reward.shape, dtype=torch.float32, device=reward.device
        )
        return observation_spec

    def get_extra_state(self) -> dict[str, Any]:
        """Return the return's statistics, and the running returns."""
        return {"moments": self.moments.state(), "running": self._running}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Take over what was seen."""
        self.moments.load(state["moments"])
        self._running = state["running"]
