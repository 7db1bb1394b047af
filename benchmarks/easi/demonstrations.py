"""Demonstrations: a policy acts on the target, and a log keeps what it saw, said and did.

    demonstrate("outputs/.../udr", trajectories=200, seed=0, path=Path("demonstrations.csv"))

A trajectory has as many steps as the task's longest episode; where an episode ends before, the next
one begins within it. Actions are drawn, as in training.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from envs.effects import load_effects
from envs.models import named
from envs.randomization import Randomization
from envs.simulation import Simulation
from hardware.log import Log, write_log
from sim2real.deployment.trained import load_policy
from sim2real.diagnosis.data.recording import columns_of
from sim2real.identification.data import Act

STREAM = 7  # of randomness: the episodes' starts


def demonstrate(
    policy: str | Path, trajectories: int, seed: int, path: Path, effects: str | Path | None = None
) -> Path:
    """Let a trained policy act on the target and write the log."""
    trained = load_policy(policy)
    fixed = () if effects is None else load_effects(effects)
    world = replace(trained.environment, tasks=Randomization(), fixed=fixed)
    rows = world.base_rows(trajectories)
    columns = record(rows, trained.controller(num_rows=trajectories, explore=seed), seed)
    return write_log(path, Log(columns))


def record(rows: Simulation, act: Act, seed: int) -> dict[str, np.ndarray]:
    """Return a log's columns of one trajectory in each row, episode after episode."""
    count, rng = rows.num_rows, np.random.default_rng([seed, STREAM])
    every, none = np.arange(count), np.zeros((count, 0))
    seen = np.array(rows.reset(every, none, _seeds(rng, count)))
    episodes: list[list[np.ndarray]] = []
    open_: list[list[np.ndarray]] = [[] for _ in every]
    for step in range(rows.max_steps):
        said = np.clip(act(seen), rows.action_low, rows.action_high)
        before = np.hstack([rows.plant.qpos, rows.plant.qvel])
        taken = rows.step(None, said)
        goal = rows.plant.ctrl.copy()
        for i in every:
            open_[i].append(np.concatenate([before[i], goal[i], seen[i], said[i]]))
        after = np.hstack([rows.plant.qpos, rows.plant.qvel])
        over = taken.terminated | taken.truncated | (step == rows.max_steps - 1)
        for i in np.flatnonzero(over):  # the last state, under the command that is held
            last = np.concatenate([after[i], goal[i], taken.observation[i], said[i]])
            if not taken.failed[i]:
                episodes.append([*open_[i], last])
            open_[i] = []
        seen = np.array(taken.observation)
        ended = np.flatnonzero(over)
        if len(ended):
            seen[ended] = rows.reset(ended, none[ended], _seeds(rng, len(ended)))
    return _columns(rows, episodes)


def _seeds(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.integers(0, 2**63, count, dtype=np.uint64)


def _columns(rows: Simulation, episodes: list[list[np.ndarray]]) -> dict[str, np.ndarray]:
    """Return the columns of episodes whose rows hold state, command, observation and action."""
    model, lengths = rows.plant.nominal, [len(episode) for episode in episodes]
    joints = [columns_of(model, i) for i in range(model.njnt)]
    names = [f"qpos.{name}" for names, _ in joints for name in names]
    names += [f"qvel.{name}" for _, names in joints for name in names]
    names += [f"ctrl.{actuator.name}" for actuator in named(rows.task.spec()).actuators]
    names += [f"obs.{i}" for i in range(rows.observation_size)]
    names += [f"action.{i}" for i in range(rows.action_size)]
    table = np.concatenate([np.stack(episode) for episode in episodes])
    time = np.concatenate([rows.task.dt * np.arange(length) for length in lengths])
    episode = np.repeat(np.arange(len(lengths)), lengths)
    return {"episode": episode, "time": time} | dict(zip(names, table.T, strict=True))
