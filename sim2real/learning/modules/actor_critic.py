"""Policies as tensordict modules: an actor, a critic, and what both share.

    policy = actor_critic(env, actor=partial(MLP, num_cells=[64, 64]), critic=partial(...))
    env.append_transform(...)                       # for each of policy.primers()
    policy.actor(env.reset())["action"]             # drawn; its probability under action_log_prob
    policy.critic(tensordict)["state_value"]

Sizes come from the environment's specs. A network is any class that takes `in_features` and
`out_features`, such as `torchrl.modules.MLP`; a shared body one that finds its sizes itself, such
as `torchrl.modules.ConvNet`; a memory is made like `torchrl.modules.GRUModule`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Literal

import torch
from tensordict import NestedKey
from tensordict.nn import (
    AddStateIndependentNormalScale,
    ProbabilisticTensorDictSequential,
    TensorDictModule,
    TensorDictModuleBase,
    TensorDictSequential,
)
from torch import nn
from torchrl.envs import EnvBase, InitTracker, Transform
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator

from sim2real.runs.errors import Sim2RealError

Network = Callable[..., nn.Module]
HIDDEN_GAIN, MEAN_GAIN, VALUE_GAIN = 2**0.5, 0.01, 1.0  # as Stable-Baselines3 2.9 initializes
FEATURES, MEMORY = "features", "recurrent_state"


class Policy(nn.Module):
    """The actor and the critic of a policy-gradient method.

    Args:
        actor: maps the environment's entries to "action" and "action_log_prob".
        critic: maps the same to "state_value"; None for an actor alone.
        head: the part of the critic behind what it shares with the actor, which the loss calls
            after the actor; None where they share nothing.
        memory: the recurrent module in the actor; None for a policy without.
        window: steps that a gradient reaches back.

    Attributes:
        squash: how a mean becomes an action between its limits.
    """

    squash: ClassVar[Literal["clip", "tanh"]] = "clip"

    def __init__(
        self,
        actor: ProbabilisticTensorDictSequential,
        critic: TensorDictModuleBase | None,
        head: TensorDictModuleBase | None = None,
        memory: Any = None,
        window: int = 1,
    ) -> None:
        super().__init__()
        self.actor, self.critic = actor, critic
        self._head, self._memory, self.window = head, memory, window

    @property
    def loss_critic(self) -> TensorDictModuleBase | None:
        """The critic as the loss calls it: after the actor, without what both share."""
        return self.critic if self._head is None else self._head

    def network(self, actor: Any) -> nn.Module | None:
        """Return the module from one entry to an actor's means; None if there is more to it."""
        plain = self._head is None and len(actor.in_keys) == 1
        return actor[0].module[0] if plain else None

    def primers(self) -> list[Transform]:
        """Return the transforms that the policy needs: starts of episodes and its memory there."""
        return [] if self._memory is None else primers_of(self._memory)


def primers_of(memory: Any) -> list[Transform]:
    """Return the transforms that a recurrent module needs."""
    return [InitTracker(), memory.make_tensordict_primer()]


def actor_critic(
    env: EnvBase,
    *,
    actor: Network,
    critic: Network | None,
    in_keys: Sequence[str] = ("observation",),
    body: Mapping[str, Network] | None = None,
    memory: Network | None = None,
    window: int = 1,
    log_std: float = 0.0,
    orthogonal: bool = True,
) -> Policy:
    """Make a Gaussian actor whose deviation does not depend on the state, and a critic.

    Args:
        env: its specs say the sizes.
        actor: makes the network of the actions' means.
        critic: makes the network of the value; None for an actor alone.
        in_keys: entries that are seen, side by side.
        body: networks that actor and critic share, by name and in order; None for none.
        memory: makes a recurrent module whose output both see, too; None for none.
        window: steps that a gradient reaches back through the memory.
        log_std: logarithm of the actions' first standard deviation.
        orthogonal: whether weights start orthogonal (Saxe et al. 2014), with the gains of
            Stable-Baselines3 2.9; else as their modules draw them.

    Raises:
        Sim2RealError: entries that the environment does not show, networks that do not fit.
    """
    if window < 1:
        raise Sim2RealError(f"policy.window={window} must be at least 1")
    shared: list[Any] = []
    seen: list[NestedKey] = list(in_keys)
    recurrent = None
    check_keys("policy.in_keys", seen, env)
    if body:
        shared.append(Module(nn.Sequential(*(make() for make in body.values())), seen, [FEATURES]))
        seen = [FEATURES]
    if memory is not None:
        size = _size(env, seen, shared)
        keys = {"in_keys": [seen[0], MEMORY], "out_keys": ["memory", ("next", MEMORY)]}
        recurrent = memory(input_size=size, **keys)
        shared.append(recurrent)
        seen = [*seen, "memory"]
    size = _size(env, seen, shared, recurrent)
    count = env.action_spec.shape[-1]
    mean = actor(in_features=size, out_features=count)
    value = None if critic is None else critic(in_features=size, out_features=1)
    if orthogonal:
        for module in shared:
            initialize(module, HIDDEN_GAIN)
        initialize(mean, MEAN_GAIN)
        if value is not None:
            initialize(value, VALUE_GAIN)
    scale = AddStateIndependentNormalScale(count, init_value=log_std)
    drawn = gaussian([*shared, *_spread(mean, scale, seen)], env)
    if value is None:
        return Policy(drawn, None, memory=recurrent, window=window)
    head = ValueOperator(value, in_keys=seen)
    whole = TensorDictSequential([*shared, head]) if shared else head
    return Policy(drawn, whole, head if shared else None, recurrent, window)


def gaussian(modules: Sequence[Any], env: EnvBase) -> Any:
    """Return modules that write "loc" and "scale" as an actor that draws from a normal law."""
    return ProbabilisticActor(
        TensorDictSequential(*modules) if len(modules) > 1 else modules[0],
        in_keys=["loc", "scale"],
        spec=env.action_spec,
        distribution_class=IndependentNormal,
        return_log_prob=True,
    )


Module = TensorDictModule


def _spread(mean: nn.Module, scale: nn.Module, seen: list[NestedKey]) -> list[Module]:
    """Return the modules that write the normal distribution: a single one for a single entry."""
    both: list[NestedKey] = ["loc", "scale"]
    if len(seen) == 1:
        return [Module(nn.Sequential(mean, scale), seen, both)]
    return [Module(mean, seen, ["loc"]), Module(scale, ["loc"], both)]


def _size(
    env: EnvBase,
    keys: Sequence[NestedKey],
    shared: Sequence[TensorDictModuleBase],
    memory: Any = None,
) -> int:
    """Return how many numbers the entries have, side by side, behind what is shared."""
    data = env.fake_tensordict().to("cpu")  # where networks are made
    if memory is not None:
        lead, gru = data.batch_size, memory.gru
        data[MEMORY] = torch.zeros(*lead, gru.num_layers, gru.hidden_size)
        data["is_init"] = torch.zeros(*lead, 1, dtype=torch.bool)
    try:
        with torch.no_grad():
            for module in shared:  # networks that find their sizes find them here
                data = module(data)
    except RuntimeError as error:
        read = {key: data[key] for key in shared[0].in_keys}
        shown = ", ".join(f"{k} {tuple(x.shape[1:])} {x.dtype}" for k, x in read.items())
        reason, remedy = str(error).splitlines()[0], ""  # tensordict's own words are its cause
        if any(_is_unconverted(x) for x in read.values()):
            remedy = "; images need a transform such as ToTensorImage: transforms=pixels"
        elif any(x.ndim > 3 for x in read.values()):
            remedy = "; the image is too small for them: give a larger one, or smaller kernels"
        raise Sim2RealError(
            f"policy: its networks cannot read {shown} ({reason}){remedy}"
        ) from error
    return sum(data[key].shape[-1] for key in keys)


def _is_unconverted(image: torch.Tensor) -> bool:
    """Return whether an image, (N, H, W, C) or of bytes, is as a camera gives it."""
    last = image.ndim > 3 and image.shape[-1] < min(image.shape[-3:-1])
    return last or image.dtype == torch.uint8


def check_keys(where: str, keys: Sequence[Any], env: EnvBase) -> None:
    """Raise Sim2RealError for a key that an environment does not show."""
    there = env.full_observation_spec.keys(True, True)
    for key in keys:
        if key not in there:
            names = ", ".join(k if isinstance(k, str) else ".".join(k) for k in there)
            raise Sim2RealError(f"{where}: {key!r} is not shown; the environment shows: {names}")


def check_policy(env: EnvBase, policy: Any) -> None:
    """See that a policy's actor reads what an environment shows, and acts as it wants.

    Raises:
        Sim2RealError: no tensordict module, an entry that is not there, actions of another shape.
    """
    actor = policy.actor
    if not isinstance(actor, TensorDictModuleBase):
        raise Sim2RealError(
            f"policy: the actor is a {type(actor).__name__}, no tensordict module; wrap it in "
            "tensordict.nn.TensorDictModule with in_keys and out_keys"
        )
    check_keys("policy: the actor reads", actor.in_keys, env)
    with torch.no_grad():
        data = actor(env.fake_tensordict())
    for key in ("action", "action_log_prob"):
        if key not in data:
            raise Sim2RealError(
                f"policy: the actor writes {', '.join(map(str, actor.out_keys))}, no {key!r}; give "
                "a torchrl.modules.ProbabilisticActor with return_log_prob=True"
            )
    wanted, found = env.action_spec.shape, data["action"].shape
    if wanted != found or not data["action"].is_floating_point():
        raise Sim2RealError(
            f"policy: the actor's distribution draws actions of shape {tuple(found[1:])} and type "
            f"{data['action'].dtype}, the environment takes {tuple(wanted[1:])} of "
            f"{env.action_spec.dtype}"
        )


@torch.no_grad()
def initialize(module: nn.Module, last_gain: float) -> None:
    """Draw orthogonal weights (Saxe et al. 2014), the last layer's of its own gain; biases are 0.

    Recurrent layers keep what torch draws: uniform within 1 / sqrt(size).
    """
    kinds = (nn.Linear, nn.Conv2d)
    layers = [layer for layer in module.modules() if isinstance(layer, kinds)]
    for layer in layers:
        gain = last_gain if layer is layers[-1] else HIDDEN_GAIN
        nn.init.orthogonal_(layer.weight, gain)
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)
