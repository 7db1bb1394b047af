"""Columns of a log in other rows, within each episode.

shift_held(log, log.columns["ctrl.elbow"], 1)         # as it is a row later
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import mujoco
import numpy as np

from hardware.log import Log

TURN = 2 * math.pi
COMMAND, READING, SPEED, TIME = "ctrl", "qpos", "qvel", "time"

Columns = Mapping[str, np.ndarray]


def split_episodes(log: Log) -> list[np.ndarray]:
    """Return the rows of each episode."""
    return np.split(np.arange(len(log)), np.flatnonzero(np.diff(log.episode)) + 1)


def map_episodes(
    log: Log, column: np.ndarray, change: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return a column that is changed in each episode by itself."""
    return np.concatenate([change(column[own]) for own in split_episodes(log)])


def shift_held(log: Log, column: np.ndarray, later: int) -> np.ndarray:
    """Return a column as it is so many rows later, held at an episode's ends."""
    rows = [np.clip(own + later, own[0], own[-1]) for own in split_episodes(log)]
    return column[np.concatenate(rows)]


def shift_rows(log: Log, column: np.ndarray, later: int) -> np.ndarray:
    """Return a column as it is so many rows later; at an episode's ends it goes on straight."""
    found = np.empty(len(log))
    for own in split_episodes(log):
        ends = np.clip(own + later, own[0], own[-1])
        first, last = np.diff(column[own])[[0, -1]]
        beyond = own + later - ends
        found[own] = column[ends] + beyond * np.where(beyond < 0, first, last)
    return found


def shift_readings(log: Log, joints: Sequence[str], late: float) -> Columns:
    """Return readings that were taken so many rows before their stamps at the rows of then."""
    rows, seconds = round(late), late * float(np.median(np.diff(log.time)))
    found = {}
    for joint in joints:
        for name in (f"{READING}.{joint}", f"{SPEED}.{joint}"):
            if name in log.columns:
                found[name] = shift_rows(log, log.columns[name], rows)
        stamps = log.columns.get(f"stamp.{joint}", log.time)
        found[f"stamp.{joint}"] = shift_rows(log, stamps, rows) - seconds
    return found


def unwrap_turns(log: Log, column: np.ndarray) -> np.ndarray:
    """Return angles without their jumps by whole turns."""
    return map_episodes(log, column, np.unwrap)


def find_jump(log: Log, name: str) -> tuple[float, float, float] | None:
    """Return the first whole turns by which a column jumps, since when and until when [s]."""
    turns = np.round((log.columns[name] - unwrap_turns(log, log.columns[name])) / TURN)
    rows = np.flatnonzero(turns)
    if not len(rows):
        return None
    last = rows[0] + int(
        np.argmin(np.append(log.episode[rows[0] :] == log.episode[rows[0]], False))
    )
    return float(turns[rows[0]]), float(log.time[rows[0]]), float(log.time[last - 1])


def find_bases(model: mujoco.MjModel, joints: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield each joint with those whose angle its own may have in it.

    An angle from the ground has that of the joint that carries it; a formula's slip, that of the
    column before it.
    """
    of_body = {int(model.joint(name).bodyid[0]): name for name in joints}
    found = list(zip(joints[1:], joints, strict=False))
    for body, name in of_body.items():
        above = int(model.body_parentid[body])
        while above and above not in of_body:
            above = int(model.body_parentid[above])
        if above:
            found.append((name, of_body[above]))
    yield from dict.fromkeys(found)
