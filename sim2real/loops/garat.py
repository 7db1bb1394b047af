"""GARAT: actions are changed so that the simulator's transitions look like the robot's.

    learned = ground(world, real, algorithm, parts, critic, frames=200_000)
    write(out / "grounding.npz", learned)               # transforms=grounded takes it

Desai, Durugkar, Karnan, Warnell, Hanna and Stone, "An imitation from observation approach to
transfer learning with dynamics mismatch" (NeurIPS 2020). A policy acts in the simulator; a second
one, the action transformer, sees what it sees and says, and what it answers is added to the action.
It is paid by a critic that learns to part these transitions from the robot's. The critic is EASI's
(`identification.scores.critic`), so that the two differ in what they move: parameters, or actions.
GARAT's own is a classifier; this one is a Wasserstein critic, whose numbers are paid less their
mean over what was seen last, so that long episodes are worth nothing by themselves.

It has no `Method.fit`: what it finds is a policy and no distribution of parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch

from envs.params import ParamSpace
from envs.rows import Rows, Step
from envs.torch_env import RowsEnv
from sim2real.identification.data import Act
from sim2real.identification.scores.critic import Critic
from sim2real.learning.algorithms.base import Algorithm, Parts, build
from sim2real.learning.environment import Environment
from sim2real.runs.errors import Sim2RealError

REACH = 0.5  # what may be added to an action, in ranges of the action
Watch = Callable[[dict[str, float], int], None]  # an iteration's metrics, steps so far


class Judge:
    """Keeps what was seen in simulation, learns from it, and pays for being like the robot.

    Args:
        critic: parts real transitions from simulated ones.
        real: the robot's transitions, (N, 2 O + A): observation, action, change of observation.
        observation: O.
        seed: of the critic.
    """

    def __init__(self, critic: Critic, real: np.ndarray, observation: int, seed: int) -> None:
        critic.begin(observation, seed)
        self._critic, self._real = critic, real
        self._seen: list[np.ndarray] = []
        self._mean, self._turn = 0.0, 0

    def pay(self, transitions: np.ndarray) -> np.ndarray:
        """Keep transitions (n, 2 O + A), one of each row; return what they pay, (n,)."""
        self._seen.append(transitions)
        if not self._turn:
            return np.zeros(len(transitions))
        return self._critic.judged(self._real, transitions) - self._mean

    def learn(self) -> float:
        """Train the critic on what was seen since; return by how much real seems more real."""
        seen = np.stack(self._seen, axis=1)  # (n, T, F)
        self._mean = -float(self._critic(self._real, seen, self._turn).mean())
        self._seen, self._turn = [], self._turn + 1
        return float(self._critic.judged(self._real, self._real).mean()) - self._mean


class ActedRows:
    """Rows in which a policy acts, and what is decided is what is added to its actions.

    They show what the policy sees and says, (n, O + A).

    Args:
        rows: of the simulator.
        act: the policy; it is asked with the observations of all rows.
        pay: gives transitions (n, 2 O + A) their reward, (n,).
    """

    def __init__(self, rows: Rows, act: Act, pay: Callable[[np.ndarray], np.ndarray]) -> None:
        self._rows, self._act, self._pay = rows, act, pay
        self.num_rows, self.max_steps, self.space = rows.num_rows, rows.max_steps, ParamSpace(())
        self.action_size = rows.action_size
        self.observation_size = rows.observation_size + rows.action_size
        self.action_high = REACH * (rows.action_high - rows.action_low)
        self.action_low = -self.action_high
        self._now = np.zeros((self.num_rows, self.observation_size))

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Start an episode in each of the rows ids (n,); see `Rows`."""
        seen = self._now[:, : self._rows.observation_size].copy()
        seen[ids] = self._rows.reset(ids, np.zeros((len(ids), 0)), seeds)
        self._now[ids] = self._said(seen)[ids]
        return self._now[ids]

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Advance all rows by one control step of the policy's actions and (n, A) more."""
        if ids is not None and len(ids) < self.num_rows:
            raise Sim2RealError("rows that a policy acts in are stepped all at once")
        low, high, size = self._rows.action_low, self._rows.action_high, self._rows.observation_size
        before, said = np.split(self._now, [size], axis=1)
        step = self._rows.step(None, np.clip(said + action, low, high))
        reward = self._pay(np.hstack([before, said, step.observation - before]))
        self._now = self._said(np.array(step.observation))
        return step._replace(observation=self._now.copy(), reward=reward)

    def _said(self, seen: np.ndarray) -> np.ndarray:
        """Return what is seen, (n, O), and what the policy says then, within its limits."""
        said = np.clip(self._act(seen), self._rows.action_low, self._rows.action_high)
        return np.hstack([seen, said])


def ground(
    rows: Callable[[int], Rows],
    act: Callable[[int], Act],
    real: np.ndarray,
    parts: Parts,
    algorithm: Callable[..., Algorithm],
    critic: Critic,
    frames: int,
    watch: Watch = lambda metrics, frames: None,
) -> Any:
    """Learn what to add to actions.

    Args:
        rows: makes so many rows of the simulator.
        act: makes the policy whose demonstrations are given, for so many rows.
        real: the robot's transitions under that policy, (N, 2 O + A).
        parts: what the action transformer is trained with; their world is not used.
        algorithm: trains it, such as PPO.
        critic: see `Judge`.
        frames: environment steps of it.
        watch: called after each iteration.

    Returns:
        The action transformer, a torch module from (n, O + A) to (n, A).

    Raises:
        Sim2RealError: an algorithm whose policy is no function of what it sees.
    """
    judge = Judge(critic, real, rows(1).observation_size, parts.seed)

    def base(num_envs: int, device: torch.device | str = "cpu") -> RowsEnv:
        return RowsEnv(ActedRows(rows(num_envs), act(num_envs), judge.pay), device)

    environment = Environment(partial(base), transforms=parts.environment.transforms)
    learner = build(algorithm, replace(parts, environment=environment))
    with closing(learner):
        while learner.frames < frames:
            metrics = learner.iterate()
            watch(metrics | {"train/critic_gap": judge.learn()}, learner.frames)
        found = learner.trained()
    if found.program is None:
        raise Sim2RealError("garat needs a policy that is one network; use policy=actor_critic")
    return found.program(found.theta)
