"""Episodes of a simulated robot with their log, as a real one would write it.

recorded = record(robot, trained.controller(num_rows=50), seeds, values)
recorded.returns, recorded.log              # (50,), and one log of 50 episodes
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from envs.models import columns_of, named
from envs.simulation import Simulation
from hardware.log import Log

Act = Callable[[np.ndarray], np.ndarray]  # observations (n, O) to actions (n, A)


class RecordedEpisodes(NamedTuple):
    """Returns, lengths and logs of n episodes."""

    returns: np.ndarray  # (n,)
    lengths: np.ndarray  # (n,) control steps
    log: Log  # of all of them, in their order


def record(
    robot: Simulation, act: Act, seeds: np.ndarray, values: np.ndarray | None = None
) -> RecordedEpisodes:
    """Run one episode in each of the first rows; return positions, velocities and commands, too.

    Args:
        robot: has as many rows as there are seeds.
        act: maps observations of all rows to their actions.
        seeds: the seeds of the episodes, (n,) uint64.
        values: parameters of the robots, (n, P); None for those of the model.

    Returns:
        Among others a log whose rows hold the state before each command and, last of each episode,
        at its end.
    """
    alive = np.arange(len(seeds))
    values = robot.space.points(len(seeds)) if values is None else values
    observation = np.array(robot.reset(alive, values, seeds))
    returns, lengths = np.zeros(len(seeds)), np.zeros(len(seeds), np.int64)
    episodes: list[list[np.ndarray]] = [[] for _ in seeds]
    while len(alive):
        action = np.clip(act(observation)[alive], robot.action_low, robot.action_high)
        command = robot.task.command(robot.state(alive), action)
        _note(robot, alive, command, episodes)
        step = robot.step(alive, action)
        observation[alive] = step.observation
        returns[alive] += step.reward
        lengths[alive] += 1
        over = np.logical_or(step.terminated, step.truncated)
        _note(robot, alive[over & ~step.failed], command[over & ~step.failed], episodes)
        alive = alive[~over]
    return RecordedEpisodes(returns, lengths, _log(robot, [np.array(rows) for rows in episodes]))


def _note(
    robot: Simulation, ids: np.ndarray, command: np.ndarray, to: list[list[np.ndarray]]
) -> None:
    """Append a row (positions, velocities, commands) to each of the episodes ids."""
    if len(ids):
        qpos, qvel = robot.plant.measured(ids)
        for i, row in zip(ids, np.concatenate([qpos, qvel, command], axis=1), strict=True):
            to[i].append(row)


def _log(robot: Simulation, episodes: list[np.ndarray]) -> Log:
    """Return episodes (T, nq + nv + nu) as a log."""
    model = robot.plant.nominal
    every = np.concatenate(episodes)
    dt = robot.task.frame_skip * model.opt.timestep
    columns = {
        "episode": np.repeat(np.arange(len(episodes)), [len(e) for e in episodes]),
        "time": np.concatenate([dt * np.arange(len(e)) for e in episodes]),
    }
    for i, actuator in enumerate(named(robot.task.spec()).actuators):
        columns[f"ctrl.{actuator.name}"] = every[:, model.nq + model.nv + i]
    for i in range(model.njnt):
        first = int(model.jnt_qposadr[i]), model.nq + int(model.jnt_dofadr[i])
        for kind, start, names in zip(("qpos", "qvel"), first, columns_of(model, i), strict=True):
            columns |= {f"{kind}.{name}": every[:, start + k] for k, name in enumerate(names)}
    return Log(columns, {"robot": type(robot.task).__name__, "rate": 1 / dt})
