"""Any tensordict actor as the policy of a population: a flat vector, and many of them at once.

    policy = flat_policy(actor_critic(env, ...), env) # its actor sees "observation"
    slots = policy.slots(256)
    slots.load(np.arange(256), thetas)                # a parameter vector per row; memories start
    action = slots.act(None, observation)             # (256, 3), each row by its own parameters

A perceptron around whose output a Gaussian draws acts as `MLPPolicy` does, at its speed. Any other
actor is called for all rows at once by `torch.func`, and so must be one that `vmap` can call; a
recurrent one takes `GRUModule(python_based=True)`, and each row has its own memory. As there,
a row's action depends on nothing but its own parameters, memory and observation, to the last bit.
Actions are cut at their limits, as `RowsEnv` cuts them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import (
    AddStateIndependentNormalScale,
    InteractionType,
    ProbabilisticTensorDictModule,
    ProbabilisticTensorDictSequential,
    TensorDictModuleBase,
)
from torch import nn
from torch.func import functional_call, vmap
from torch.nn.utils import parameters_to_vector, vector_to_parameters
from torchrl.envs import EnvBase, Transform
from torchrl.modules import GRUModule, IndependentNormal, LSTMModule

from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.dense import Dense, read_dense
from sim2real.learning.modules.mlp_policy import (
    MLPPolicy,
    MLPPolicyBatch,
    action_limits,
    observation_size,
)
from sim2real.learning.modules.value import Critic, FunctionalCritic
from sim2real.learning.population.flat_policy import FlatPolicy
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
BLOCK = 32  # rows that are called at once, always as many: vector units round what is left over
# otherwise than whole vectors, so that with blocks of one size a row's neighbours do not matter


@runtime_checkable
class Acts(Protocol):
    """A policy of tensordict modules, as `sim2real.learning.modules.actor_critic.Policy` is."""

    actor: TensorDictModuleBase

    def network(self, actor: Any) -> nn.Module | None:
        """Return the module from one entry to an actor's means; None if there is more to it."""
        ...

    def primers(self) -> Sequence[Transform]:
        """Return the transforms that the actor needs."""
        ...


def flat_policy(made: Any, env: EnvBase, critic: bool = False) -> FlatPolicy:
    """Return a policy as one whose parameters are a vector; of tensordict modules its actor counts.

    Args:
        made: an `MLPPolicy`, or a policy with an actor.
        env: what it was made for.
        critic: whether its critic's parameters stand behind the actor's.

    Raises:
        Sim2RealError: for anything else, an actor that a population cannot have, or a critic that
            is not there.
    """
    if critic:
        FunctionalCritic(getattr(made, "critic", None))
    elif isinstance(made, MLPPolicy):
        return made
    if not isinstance(made, Acts) or not isinstance(made.actor, TensorDictModuleBase):
        raise Sim2RealError(
            f"algorithm=esmaml searches the parameters of an actor, but {type(made).__name__} has "
            f"no "
            "tensordict module of that name; use policy=linear, policy=mlp or policy=actor_critic"
        )
    return ActorPolicy(
        made.actor, env, made.network, made.primers, getattr(made, "critic", None), critic
    )


class ActorPolicy:
    """The deterministic actions of an actor, with any parameters.

    Args:
        actor: maps "observation" to "action", on the CPU. Its present parameters are the first.
        env: its specs say what is seen and the actions' limits.
        network: see `Acts`; the default is that of an actor that is not a function.
        primers: see `Acts`.
        critic: the policy's critic, if any.
        searched: whether the critic's parameters stand behind the actor's; what acts leaves them
            out.

    Raises:
        Sim2RealError: for an actor that reads other entries, or that many rows cannot call at once.
    """

    cut = True

    def __init__(
        self,
        actor: TensorDictModuleBase,
        env: EnvBase,
        network: Callable[[Any], nn.Module | None] = lambda actor: None,
        primers: Callable[[], Sequence[Transform]] = tuple,
        critic: TensorDictModuleBase | None = None,
        searched: bool = False,
    ) -> None:
        self.actor = deepcopy(actor).requires_grad_(False)
        for module in self.actor.modules():
            # Not by set_exploration_type: that is one switch for the threads of all shards.
            if isinstance(module, ProbabilisticTensorDictModule):
                module.default_interaction_type = InteractionType("deterministic")
        self._network, self.primers = network, primers
        self.action_low, self.action_high = action_limits(env)
        self.observation_size = observation_size(env)
        self.action_size = len(self.action_low)
        self.memory = _memory(self.actor)
        others = {*self.actor.in_keys} - {"observation", "is_init", *self.memory}
        if others:
            names = ", ".join(map(str, sorted(others, key=str)))
            raise Sim2RealError(
                f"policy: members of a population do not receive {names}; remove it"
            )
        self._perceptron = _perceptron(self)
        self.critic = None
        if searched and critic is not None:
            self.critic = deepcopy(critic).requires_grad_(False)
        self.actor_parameters = sum(p.numel() for p in self.actor.parameters())
        self.num_parameters = sum(p.numel() for _, p in self._named())
        if self._perceptron is None:
            self._try()

    def _try(self) -> None:
        slots = ActorSlots(self, 1)
        try:
            slots.act(None, np.zeros((1, self.observation_size)))
        except RuntimeError as error:
            reason = str(error).splitlines()[0]
            raise Sim2RealError(
                f"policy: torch.func.vmap cannot call the actor for many rows ({reason}); a GRU "
                "needs policy.memory.python_based=true"
            ) from error

    @property
    def shape(self) -> dict[str, Any]:
        """The architecture that a parameter vector must fit: the shape of each parameter."""
        return {name: list(p.shape) for name, p in self._named()}

    def _named(self) -> list[tuple[str, nn.Parameter]]:
        critic = [] if self.critic is None else self.critic.named_parameters()
        return [*self.actor.named_parameters(), *((f"critic.{name}", p) for name, p in critic)]

    def initial(self, rng: np.random.Generator) -> np.ndarray:
        """Return its own first parameters, (num_parameters,) float32."""
        return parameters_to_vector(p for _, p in self._named()).numpy().astype(np.float32)

    def valuing(self, theta: np.ndarray, unit: float) -> Critic | None:
        """Return the critic of parameters (num_parameters,); None where it is not searched.

        Args:
            theta: the parameters.
            unit: what rewards are divided by before it values them.
        """
        if self.critic is None:
            return None
        critic = deepcopy(self.critic)
        own = torch.from_numpy(np.array(theta[self.actor_parameters :], np.float32))
        vector_to_parameters(own, critic.parameters())
        return Critic(critic, unit)

    def slots(self, num_rows: int) -> ActorSlots | PerceptronSlots:
        """Make room for `num_rows` parameter vectors that act side by side."""
        if self._perceptron is not None:
            return PerceptronSlots(self._perceptron, read_dense(self.actor), num_rows)
        return ActorSlots(self, num_rows)

    @property
    def is_function(self) -> bool:
        """Whether an action follows from one observation, by a network of the actor's."""
        return self._network(self.actor) is not None

    def acting(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> NormalizedActor:
        """Return the actor with parameters (num_parameters,), shown raw observations.

        Args:
            theta: the parameters, (num_parameters,).
            mean: what normalization subtracts from an observation, (O,).
            std: what it divides by, (O,).
        """
        return NormalizedActor(self._with(theta), mean, std)

    def module(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Actor:
        """Return the same as a torch module of raw observations; see `acting`."""
        network = self._network(self._with(theta))
        assert network is not None
        return Actor(network, mean, std, self.action_low, self.action_high)

    def _with(self, theta: np.ndarray) -> TensorDictModuleBase:
        actor = deepcopy(self.actor)
        vector_to_parameters(torch.from_numpy(np.array(theta, np.float32)), actor.parameters())
        return actor


class NormalizedActor(TensorDictModuleBase):
    """An actor that is shown raw observations and sees them normalized.

    Args:
        actor: sees "observation".
        mean: what is subtracted from an observation, (O,).
        std: what it is divided by, (O,).
    """

    mean: Tensor
    std: Tensor

    def __init__(self, actor: TensorDictModuleBase, mean: np.ndarray, std: np.ndarray) -> None:
        super().__init__()
        self.actor, keys = actor, cast("Any", actor)
        self.in_keys, self.out_keys = keys.in_keys, keys.out_keys
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float64))
        self.register_buffer("std", torch.tensor(std, dtype=torch.float64))

    def forward(self, tensordict: TensorDict) -> TensorDict:
        """Add what the actor writes."""
        raw = tensordict["observation"]
        seen = tensordict.copy().set("observation", ((raw - self.mean) / self.std).float())
        out = self.actor(seen)
        return tensordict.update(out.select(*self.out_keys, strict=False))


class PerceptronSlots:
    """`MLPPolicyBatch` for parameters in the order of torch's linear layers.

    Args:
        policy: the same network, as `MLPPolicy` has it.
        network: its layers.
        num_rows: R, parameter vectors held.
    """

    def __init__(self, policy: MLPPolicy, network: Dense, num_rows: int) -> None:
        self._slots, self._order = MLPPolicyBatch(policy, num_rows), _order(network)
        self._low, self._high = policy.action_low, policy.action_high

    def load(self, ids: np.ndarray, thetas: np.ndarray) -> None:
        """Put parameter vectors (n, num_parameters) into rows (n,)."""
        self._slots.load(ids, thetas[:, self._order])

    def act(self, ids: np.ndarray | None, observation: np.ndarray) -> np.ndarray:
        """Compute the actions (n, A) of rows ids (n,), or all, from observations (n, O)."""
        return np.clip(self._slots.act(ids, observation), self._low, self._high)


class ActorSlots:
    """Per-row parameters and memories of one actor, and a call of any of the rows.

    Args:
        policy: the actor.
        num_rows: R, parameter vectors held.
    """

    def __init__(self, policy: ActorPolicy, num_rows: int) -> None:
        self._actor = deepcopy(
            policy.actor
        )  # functional_call swaps parameters: one for each thread
        self._size, self._low, self._high = (
            policy.observation_size,
            policy.action_low,
            policy.action_high,
        )
        count = -(-num_rows // BLOCK) * BLOCK  # whole blocks
        named = dict(policy.actor.named_parameters())
        self._params = {name: p.expand(count, *p.shape).clone() for name, p in named.items()}
        self._memory = {k: torch.zeros(count, *shape) for k, shape in policy.memory.items()}
        self._all = np.arange(num_rows)
        self._begins = torch.zeros(1, dtype=torch.bool)  # never here: `load` starts memories
        self._call = vmap(self._one)

    def load(self, ids: np.ndarray, thetas: np.ndarray) -> None:
        """Put parameter vectors (n, num_parameters) into rows (n,), whose memories restart."""
        rows, start = torch.from_numpy(ids), 0
        flat = torch.from_numpy(np.asarray(thetas, np.float32))
        for stack in self._params.values():
            stop = start + stack[0].numel()
            stack[rows] = flat[:, start:stop].reshape(-1, *stack.shape[1:])
            start = stop
        for memory in self._memory.values():
            memory[rows] = 0.0

    @torch.no_grad()
    def act(self, ids: np.ndarray | None, observation: np.ndarray) -> np.ndarray:
        """Compute the actions (n, A) of rows ids (n,), or all, from observations (n, O)."""
        ids = self._all if ids is None else ids
        seen = torch.zeros(len(next(iter(self._params.values()))), self._size)
        seen[torch.from_numpy(ids)] = torch.from_numpy(observation.astype(np.float32))
        action = np.zeros((len(seen), len(self._low)))
        for block in np.unique(ids // BLOCK).tolist():
            rows = slice(block * BLOCK, (block + 1) * BLOCK)
            said, after = self._call(*self._of(rows), seen[rows])
            action[rows] = said.numpy()
            self._remember(rows, ids, after)
        return np.clip(action[ids], self._low, self._high)

    def _of(self, rows: slice) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        params = {name: stack[rows] for name, stack in self._params.items()}
        return params, {key: memory[rows] for key, memory in self._memory.items()}

    def _remember(self, rows: slice, ids: np.ndarray, after: Mapping[str, Tensor]) -> None:
        """Keep the memories of the rows that acted; the others of the block only filled it."""
        acted = torch.from_numpy(ids[(ids >= rows.start) & (ids < rows.stop)])
        for key, memory in self._memory.items():
            memory[acted] = after[key][acted - rows.start]

    def _one(
        self, params: dict[str, Tensor], memory: dict[str, Tensor], observation: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Return the action of one row and what it remembers."""
        shown = {**memory, "observation": observation, "is_init": self._begins}
        out = functional_call(self._actor, params, (TensorDict(shown, []),))
        return out["action"], {key: out["next", key] for key in memory}


def _memory(actor: nn.Module) -> dict[str, tuple[int, ...]]:
    """Return the shapes of what an actor remembers of an episode, by entry."""
    found: dict[str, tuple[int, ...]] = {}
    for module in actor.modules():
        if isinstance(module, LSTMModule):
            raise Sim2RealError(
                "policy: a GRUModule is the only memory that members of a population can have"
            )
        if isinstance(module, GRUModule):
            gru = module.gru
            found[str(module.in_keys[1])] = (gru.num_layers, gru.hidden_size)
    return found


def _perceptron(policy: ActorPolicy) -> MLPPolicy | None:
    """Return the same network for the fast path; None if the actor is not such a network."""
    actor = policy.actor
    if not isinstance(actor, ProbabilisticTensorDictSequential):
        return None
    if actor[-1].distribution_class is not IndependentNormal:
        return None
    try:
        network = read_dense(actor)
    except Sim2RealError:
        return None
    if not isinstance(network.head, AddStateIndependentNormalScale):
        return None  # the means are not what the last layer says
    return MLPPolicy(
        policy.observation_size,
        policy.action_size,
        policy.action_low,
        policy.action_high,
        hidden=network.sizes[1:-1],
        activation=network.activation,
        output="linear",
        initial="normal",
    )


def _order(network: Dense) -> np.ndarray:
    """Return where in torch's flat vector the entries of that of `MLPPolicy` are, (P,)."""
    places, start = [], 0
    for layer in network.linears:
        shape = (layer.out_features, layer.in_features)
        stop = start + shape[0] * shape[1]
        places += [np.arange(start, stop).reshape(shape).T.ravel()]
        places += [np.arange(stop, stop + shape[0])]
        start = stop + shape[0]
    return np.concatenate(places)
