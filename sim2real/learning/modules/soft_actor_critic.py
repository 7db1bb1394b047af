"""The policy that SAC trains: an actor of squashed Gaussians, and critics of its actions.

    policy = soft_actor_critic(env, actor=partial(MLP, num_cells=[256, 256]), qvalue=partial(...))
    env.append_transform(...)                       # for each of policy.primers()
    policy.actor(env.reset())["action"]             # drawn, in (-1, 1)
    policy.qvalues[0](tensordict)["state_action_value"]

Actions are in units of half the range between their limits, which a transform of the environment
scales them to.
"""

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.data import Bounded
from torchrl.envs import ActionScaling, EnvBase, Transform
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator

from sim2real.learning.modules.actor_critic import Network, check_keys
from sim2real.learning.modules.heads import NormalHead
from sim2real.runs.errors import Sim2RealError


class SoftPolicy(nn.Module):
    """The actor and the critics of SAC.

    Args:
        actor: maps the environment's entries to "action" in (-1, 1) and "action_log_prob".
        qvalues: each maps the same and "action" to its own "state_action_value".
        low: the actions' lower limits, (A,).
        high: their upper limits, (A,).

    Attributes:
        squash: how a mean becomes an action between its limits.
    """

    squash: ClassVar[Literal["clip", "tanh"]] = "tanh"

    def __init__(
        self,
        actor: ProbabilisticActor,
        qvalues: Sequence[ValueOperator],
        low: torch.Tensor,
        high: torch.Tensor,
    ) -> None:
        super().__init__()
        self.actor, self.qvalues = actor, nn.ModuleList(qvalues)
        self._middle, self._half = (high + low) / 2, (high - low) / 2

    def primers(self) -> list[Transform]:
        """Return the transform that the policy needs: actions from (-1, 1) to their limits."""
        return [ActionScaling(loc=self._middle, scale=self._half)]

    def network(self, actor: Any) -> nn.Module | None:
        """Return the module from one entry to an actor's means, before squashing."""
        whole = actor[0].module[0]
        if len(actor.in_keys) > 1 or not isinstance(whole[-1], nn.Linear):
            return None
        *layers, last = whole
        means = nn.Linear(last.in_features, last.out_features // 2)
        with torch.no_grad():
            means.weight.copy_(last.weight[: len(means.weight)])
            means.bias.copy_(last.bias[: len(means.bias)])
        return nn.Sequential(*layers, means)


def soft_actor_critic(
    env: EnvBase,
    *,
    actor: Network,
    qvalue: Network,
    in_keys: Sequence[str] = ("observation",),
    num_qvalues: int = 2,
    log_std_min: float = -20.0,
    log_std_max: float = 2.0,
) -> SoftPolicy:
    """Make an actor of squashed Gaussians, and critics that begin apart.

    Args:
        env: its specs say the sizes.
        actor: makes the network of means and logarithmic deviations.
        qvalue: makes a critic's network.
        in_keys: entries that are seen, side by side.
        num_qvalues: critics.
        log_std_min: least logarithm of a deviation.
        log_std_max: largest one.

    Raises:
        Sim2RealError: entries that the environment does not show, actions without finite limits.
    """
    check_keys("policy.in_keys", in_keys, env)
    if num_qvalues < 1:
        raise Sim2RealError(f"policy.num_qvalues={num_qvalues} must be at least 1")
    space: Any = env.action_spec_unbatched.space
    if space is None or not (space.low.isfinite() & space.high.isfinite()).all():
        raise Sim2RealError("algorithm=sac needs finite action limits; use algorithm=ppo")
    seen, count = list[NestedKey](in_keys), env.action_spec.shape[-1]
    size = sum(env.full_observation_spec[key].shape[-1] for key in seen)
    said = actor(in_features=size, out_features=2 * count)
    body = nn.Sequential(said, NormalHead(log_std_min, log_std_max))
    squashed = ProbabilisticActor(
        TensorDictModule(body, in_keys=seen, out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        spec=Bounded(-1.0, 1.0, env.action_spec.shape, dtype=torch.float32, device=env.device),
        distribution_class=TanhNormal,
        return_log_prob=True,
    )
    made = [qvalue(in_features=size + count, out_features=1) for _ in range(num_qvalues)]
    keys: list[Any] = [*seen, "action"]
    critics = [ValueOperator(one, keys) for one in made]
    return SoftPolicy(squashed, critics, space.low, space.high)
