"""A trained policy: what acts, in which world, and its parameters as one vector.

    trained = algorithm.trained()
    env = trained.make_env(50)                          # its environment, statistics frozen
    played = trained.run_episodes(seeds)                # an episode for each seed
    controller = trained.controller(trained.theta)      # a function of what a robot shows
    action = controller(observation)                    # (n, O) to (n, A), step after step

It hides which algorithm trained the policy. Evolution strategies keep their parameters in one
vector already; of any other policy the vector is that of its actor's parameters, in their order.
They may be followed by the context that the policy assumes of its robot.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters
from torchrl.envs import EnvBase, Transform, TransformedEnv
from torchrl.envs.utils import step_mdp

from envs.params import ParamSpace
from envs.rows import Step
from envs.torch_env import RowsEnv
from sim2real.learning.context import ContextSpec, set_assumed_context
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.randomness import TorchRandomStream, drawn
from sim2real.learning.modules.value import Critic
from sim2real.learning.population.rollout import EpisodeResults, Watch, run_episodes

Net = TypeVar("Net", bound=nn.Module)


@dataclass(frozen=True)
class TrainedPolicy:
    """A trained policy.

    Attributes:
        theta: its parameters, (P,) float32.
        actor: makes the policy with given parameters, (P,): a tensordict module on the CPU from
            what `make_env` shows to "action".
        environment: what it was trained in.
        statistics: state of the environment's transforms.
        primers: makes the transforms that the policy itself needs, such as those of a memory.
        program: makes the policy with given parameters as one torch module, from raw observations
            (..., O) to actions (..., A); None if it is not such a function.
        frames: environment steps of its training.
        dtype: the dtype of the observations that a robot returns.
        source: the checkpoint that it is from, if any.
        critic: what says how much it will earn in training; None where nothing does.
        cut: whether it was trained on actions that are cut at their limits, as `RowsEnv` cuts them;
            the rows of a population take them as they are.
    """

    theta: np.ndarray
    actor: Callable[[np.ndarray], TensorDictModuleBase]
    environment: EnvironmentFactory
    statistics: Mapping[str, Any]
    frames: int
    primers: Callable[[], Sequence[Transform]] = tuple
    program: Callable[[np.ndarray], nn.Module] | None = None
    dtype: torch.dtype = torch.float32
    source: Path | None = None
    critic: Critic | None = None
    clips_actions: bool = True

    @property
    def context(self) -> ContextSpec | None:
        """The robot's parameters that the policy receives; None: none."""
        return self.environment.context_spec

    def split(self, theta: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the policy's parameters, (P,), and the context that it assumes; None: not given.

        Args:
            theta: the policy's parameters, optionally followed by the context that it assumes, -1
                to 1 over the ranges; None for the trained ones.
        """
        if theta is None or len(theta) <= len(self.theta) or self.context is None:
            return self.theta if theta is None else theta, None
        return theta[: len(self.theta)], theta[len(self.theta) :]

    def run_episodes(
        self,
        seeds: np.ndarray,
        environment: EnvironmentFactory | None = None,
        values: np.ndarray | None = None,
        theta: np.ndarray | None = None,
        watch: Watch | None = None,
    ) -> EpisodeResults:
        """Run an episode for each seed; see `population.rollout.run_episodes`, and `make_env`."""
        env = self.make_env(len(seeds), environment)
        try:
            return run_episodes(env, self.acting(env, theta), values, seeds, watch)
        finally:
            env.close()

    def make_env(
        self,
        num_envs: int,
        environment: EnvironmentFactory | None = None,
        threads: int = 0,
        seed: int = 0,
    ) -> TransformedEnv:
        """Make the environment with the statistics of training, frozen.

        Args:
            num_envs: N.
            environment: another one, such as with another robot; None for that of training.
            threads: of the physics; 0 for all cores.
            seed: of its episodes.
        """
        made = self.environment if environment is None else environment
        if self.context is not None:
            made = made.with_context_spec(self.context)
        env = made.on_host.make(num_envs, threads, seed=seed, extra=self.primers())
        env.transform.load_state_dict(drop_per_row_state(self.statistics), strict=False)
        env.transform.eval()
        return env

    def over(self, base: partial[EnvBase], num_envs: int = 1) -> TransformedEnv:
        """Make the environment of the policy over another base, such as a robot; see `make_env`.

        Args:
            base: takes the `dtype` of what the policy sees and whether its actions are
                `clips_actions`.
            num_envs: N.
        """
        like: partial[EnvBase] = partial(base, dtype=self.dtype, cut=self.clips_actions)
        return self.make_env(num_envs, self.environment.with_base(like), threads=1)

    def acting(
        self, env: TransformedEnv, theta: np.ndarray | None = None, said: np.ndarray | None = None
    ) -> TensorDictModuleBase:
        """Return the policy in an environment of it, which from now on tells it what to believe.

        Args:
            env: made by `make_env` or `over`.
            theta: parameters, (P,), see `split`; None for the trained ones.
            said: what it believes of its robots, (N, P) or (P,), -1 to 1 over the ranges; None for
                what stands behind theta, or else the truth.
        """
        own, behind = self.split(theta)
        set_assumed_context(env, behind if said is None else said)
        return self.actor(own)

    def controller(
        self,
        theta: np.ndarray | None = None,
        num_rows: int = 1,
        explore: int | None = None,
        said: np.ndarray | None = None,
    ) -> PolicyController:
        """Return the policy as a function of what robots show.

        Args:
            theta: parameters, (P,), see `split`; None for the trained ones.
            num_rows: N, robots at a time.
            explore: seed of actions that are drawn; None for the means.
            said: the context that the policy assumes of its robot, (N, P) or (P,), -1 to
                1 over the ranges; None for what stands behind theta, or else the middle.
        """
        env = self.over(
            partial(ExternalObservationEnv, *self.environment.observation_and_action_spec()),
            num_rows,
        )
        return PolicyController(env, self.acting(env, theta, said), explore)

    def pilot(self, *args: Any, **kwargs: Any) -> PolicyController:
        """Return `controller(...)`, under the name that it had before 0.2."""
        message = "TrainedPolicy.pilot is now controller; the old name goes in 0.3"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return self.controller(*args, **kwargs)


def from_actor(
    policy: Any,
    environment: EnvironmentFactory,
    statistics: Mapping[str, Any],
    frames: int,
    affine: tuple[np.ndarray, np.ndarray] | None,
    unit: float = 1.0,
) -> TrainedPolicy:
    """Return the actor of a policy of tensordict modules as a trained policy.

    Args:
        policy: has `actor`, `primers()`, `network()` and `squash`, as `modules.policies.Policy`.
        environment: what it was trained in.
        statistics: state of the environment's transforms.
        frames: environment steps of its training.
        affine: what the transforms subtract from an observation and divide it by, (O,) each; None
            if they do something else to it.
        unit: what they divide rewards by.
    """
    kept = deepcopy(policy).cpu().eval()
    critic = getattr(kept, "critic", None)
    state = {name: deepcopy(value) for name, value in drop_per_row_state(statistics).items()}
    return TrainedPolicy(
        flatten_parameters(kept.actor),
        lambda theta: with_parameters(kept.actor, theta),
        environment,
        state,
        frames,
        primers=kept.primers,
        program=None if affine is None else _program(kept, environment, affine),
        critic=None if critic is None else Critic(critic, unit),
    )


def _program(
    policy: Any, environment: EnvironmentFactory, affine: tuple[np.ndarray, np.ndarray]
) -> Callable[[np.ndarray], nn.Module] | None:
    """Return the function from raw observations to the actor's means; None if there is none."""
    if policy.network(policy.actor) is None:
        return None
    _, low, high = environment.observation_and_action_spec()

    def program(theta: np.ndarray) -> nn.Module:
        network = policy.network(with_parameters(policy.actor, theta))
        return Actor(network, *affine, low, high, policy.squash)

    return program


def flatten_parameters(module: nn.Module) -> np.ndarray:
    """Return the parameters of a module as one vector, (P,) float32."""
    return parameters_to_vector(module.parameters()).detach().cpu().numpy().astype(np.float32)


def with_parameters(module: Net, theta: np.ndarray) -> Net:
    """Return a copy of a module with other parameters, (P,)."""
    copy = deepcopy(module)
    vector_to_parameters(torch.from_numpy(np.asarray(theta, np.float32)), copy.parameters())
    return copy


class ExternalObservationRows:
    """Rows whose observations are put in from outside: what a robot measures.

    Args:
        num_rows: N.
        observation_size: O.
        action_low: lower limits of the actions, (A,).
        action_high: upper limits, (A,).
    """

    max_steps = 0
    space = ParamSpace(())

    def __init__(
        self, num_rows: int, observation_size: int, action_low: np.ndarray, action_high: np.ndarray
    ) -> None:
        self.num_rows, self.observation_size = num_rows, observation_size
        self.action_low, self.action_high = action_low, action_high
        self.action_size = len(action_low)
        self.observation = np.zeros((num_rows, observation_size))

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Return the supplied observations."""
        return self.observation[ids]

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Return the supplied observations; rewards are 0 and nothing ends."""
        no = np.zeros(self.num_rows, bool)
        return Step(self.observation, np.zeros(self.num_rows), no, no, no)


def drop_per_row_state(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return the transforms' state without that of episodes in progress.

    This is what `CatFrames` keeps of each row, and the running returns of `RewardScaling`.
    """
    return {
        name: value | {"running": None} if isinstance(value, dict) and "running" in value else value
        for name, value in state.items()
        if "_cat_buffers_" not in name
    }


class ExternalObservationEnv(RowsEnv):
    """`ExternalObservationRows` rows as a TorchRL environment; see there, and `RowsEnv`."""

    def __init__(
        self,
        observation_size: int,
        action_low: np.ndarray,
        action_high: np.ndarray,
        num_envs: int = 1,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        cut: bool = True,
    ) -> None:
        self.fed = ExternalObservationRows(num_envs, observation_size, action_low, action_high)
        super().__init__(self.fed, device, dtype, cut=cut)


class PolicyController:
    """A policy as a function: the next observations of the same robots to their actions.

    Args:
        env: over a `ExternalObservationEnv`.
        actor: the policy.
        explore: seed of actions that are drawn; None for the means.
    """

    def __init__(
        self, env: TransformedEnv, actor: TensorDictModuleBase, explore: int | None = None
    ) -> None:
        self._env, self._actor = env, actor
        base: Any = env.base_env
        self._base: ExternalObservationEnv = base
        self._now: TensorDictBase | None = None
        self._randomness = None if explore is None else TorchRandomStream(explore, "cpu")

    def reset(self) -> None:
        """Start an episode: the next observation is its first."""
        self._now = None

    @torch.no_grad()
    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Map raw observations (N, O) to actions (N, A) float64."""
        self._base.fed.observation = np.asarray(observation, np.float64)
        with drawn(self._randomness):
            before = self._now
            now = self._env.reset() if before is None else step_mdp(self._env.step(before))
            self._now = self._actor(now)
            return self._base.taken(self._env.transform.inv(self._now))
