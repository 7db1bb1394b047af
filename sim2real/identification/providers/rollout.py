"""A policy acts in simulation: transitions that are like the robot's, or not.

    provider = rollout(data, effects, rows=None, seed=0)
    provider.real                        # (N, 2 O + A): observation, action, change of observation
    provider.simulate(values, turn=3)    # (n, N', 2 O + A)

The logs hold what a policy saw and said (`obs.<i>`, `action.<i>`). Each simulation runs as many
steps as the longest of their episodes, and starts again where its episode ends. Nothing is aligned:
a score compares the transitions of the two worlds as samples of two distributions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.effects import Effect
from envs.rows import Rows
from hardware.log import Log
from sim2real.identification.data import Act, Recordings
from sim2real.runs.errors import Sim2RealError

SHORTEST = 2  # rows of an episode that make a transition


def rollout(
    data: Recordings,
    effects: Sequence[Effect],
    *,
    rows: int | None = None,
    seed: int = 0,
    steps: int | None = None,
) -> Rollout:
    """Return the provider that lets a policy act.

    Args:
        data: logs with `obs.*` and `action.*`, and the world.
        effects: whose values are looked for.
        rows: not used here; what scores of another kind compare.
        seed: of the episodes.
        steps: length of each simulation; None: that of the longest logged episode.

    Raises:
        Sim2RealError: no world, logs without observations or actions, of another task, or shorter
            than a window.
    """
    return Rollout(data, effects, seed, steps)


class Rollout:
    """See `rollout`."""

    aligned = False

    def __init__(
        self, data: Recordings, effects: Sequence[Effect], seed: int, steps: int | None
    ) -> None:
        if data.world is None:
            raise Sim2RealError(
                "rollouts need a policy that acts in simulation: give checkpoint=RUN of the "
                "policy that ran in the logs, or choose identify/provider=replay"
            )
        self._world, self._effects, self._seed = data.world, tuple(effects), seed
        self._rows: Rows = self._world.rows(self._effects, 1)
        self.neutral = self._rows.space.neutral
        self.observation_size = self._rows.observation_size
        sizes = self.observation_size, self._rows.action_size
        parts = [part for log in data.logs for part in transitions(log, sizes, self._world.name)]
        longest = max(len(part) for part in parts)
        self.steps = longest if steps is None else steps
        if longest < self.steps:
            raise Sim2RealError(
                f"provider.steps={self.steps} is longer than the longest logged episode, which has "
                f"{longest} transitions; give provider.steps up to {longest}, or longer logs"
            )
        self.real = np.concatenate(parts)

    def simulate(self, values: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return the transitions of a simulation under each of values (n, P), (n, N', F)."""
        count = len(values)
        if self._rows.num_rows != count:
            self._rows = self._world.rows(self._effects, count)
        rng = np.random.default_rng([self._seed, turn])
        return collect_transitions(self._rows, self._world.act(count), values, self.steps, rng)


def collect_transitions(
    rows: Rows, act: Act, values: np.ndarray, steps: int, rng: np.random.Generator
) -> np.ndarray:
    """Let a policy act for some steps, (n, steps, 2 O + A); episodes that end start again.

    Args:
        rows: n of them.
        act: the policy.
        values: of the rows' parameters, (n, P).
        steps: of each row.
        rng: for the seeds of the episodes.
    """
    every = np.arange(len(values))
    values = np.clip(values, rows.space.low, rows.space.high)
    # all start alike: what differs between the rows is then their parameters
    observation = np.array(rows.reset(every, values, _seeds(rng, len(every))))
    found = []
    for _ in range(steps):
        action = np.clip(act(observation), rows.action_low, rows.action_high)
        step = rows.step(None, action)
        found.append(np.hstack([observation, action, step.observation - observation]))
        observation = np.array(step.observation)
        over = np.flatnonzero(np.asarray(step.terminated | step.truncated))
        if over.size:
            observation[over] = rows.reset(over, values[over], _seeds(rng, len(over)))
    return np.stack(found, axis=1)


def _seeds(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.full(count, rng.integers(0, 2**63, dtype=np.uint64))


def transitions(log: Log, sizes: tuple[int, int], task: str) -> list[np.ndarray]:
    """Return each episode's transitions, (T - 1, 2 O + A).

    Raises:
        Sim2RealError: see `rollout`.
    """
    place = log.path or "the log"
    kinds = ("obs", "action")
    names = [[f"{k}.{i}" for i in range(size)] for k, size in zip(kinds, sizes, strict=True)]
    for kind, size, own in zip(kinds, sizes, names, strict=True):
        there = [n for n in log.columns if n.startswith(f"{kind}.") and n.split(".")[1].isdigit()]
        if len(there) != size or any(name not in log.columns for name in own):
            raise Sim2RealError(
                f"{place} has {len(there)} columns {kind}.<i>, but {task} has {size}: the log "
                f"belongs to another task, or not to a policy; record episodes of the policy in "
                f"checkpoint="
            )
    found = []
    for part in log.episodes():
        seen, said = (np.column_stack([part.column(n) for n in own]) for own in names)
        if len(part) >= SHORTEST:
            found.append(np.hstack([seen[:-1], said[:-1], np.diff(seen, axis=0)]))
    if not found:
        raise Sim2RealError(f"{place}: no episode has two rows, so there are no transitions")
    return found
