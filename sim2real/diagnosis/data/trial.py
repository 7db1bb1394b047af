"""Short replays of pieces of logs, many at once.

    pieces = choose(logs, seconds=5.0)                  # where every joint moves
    paths = trial(spec, [piece.recording(model) for piece in pieces])

Each recording is one row; rows that diverge are NaN from there on.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from envs.plant import Fixed, Plant
from envs.replay import Recording, schedule, simulate, switchable
from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.recording import HUNTING, episode_rows, is_flagged, to_recording
from sim2real.diagnosis.data.speeds import NEAR

LARGEST = 2e8  # bytes of positions simulated at once
STIR = 0.02  # rad or m: a command that moves less does not stir its joint
NEWS = 0.1  # of the commands' largest motions: a further piece shows at least so much more
BYTES = 8  # of a number


class Piece(NamedTuple):
    """Some rows of one episode."""

    number: int  # of the log, in the order given
    log: Log  # all of it
    rows: slice  # which

    def recording(self, model: mujoco.MjModel) -> Recording:
        """Return the piece in the order of a model's joints and actuators."""
        return to_recording(self.log, model, self.rows.start, self.rows.stop)

    def column(self, name: str) -> np.ndarray:
        """Return a column of the log in these rows, (T,)."""
        return self.log.column(name)[self.rows]


def choose(logs: Sequence[Log], seconds: float) -> list[Piece]:
    """Return few pieces in which the commands of as many actuators as possible move.

    Each shows motions that those before it do not.
    Pieces in which a loop hunts are taken only where there are no others: no replay follows them.
    """
    cuts = list[Piece]()
    for number, log in enumerate(logs):
        for own in episode_rows(log):
            time = log.time[own]
            ends = np.searchsorted(time, np.arange(time[0], time[-1], seconds) - ROUNDING)
            rows = pairwise([*(own.start + ends).tolist(), own.stop])
            long = [slice(first, last) for first, last in rows if last - first > 2 * NEAR]
            cuts += [Piece(number, log, some) for some in long]
    hunts = [is_flagged(log, HUNTING) for log in logs]
    cuts = [one for one in cuts if not hunts[one.number][one.rows].any()] or cuts
    names = list(dict.fromkeys(name for log in logs for name in log.actuators))
    stirs = np.zeros((len(cuts), len(names)))
    for row, one in zip(stirs, cuts, strict=True):
        for place, name in enumerate(names):
            if name in one.log.actuators:
                row[place] = one.column(f"ctrl.{name}").std()
    best = stirs.max(axis=0, initial=0.0)
    shares = stirs[:, best > STIR] / best[best > STIR]
    seen, chosen = np.zeros(shares.shape[1]), []
    while len(chosen) < len(cuts):
        gains = np.maximum(shares - seen, 0.0).sum(axis=1)
        top = int(np.argmax(gains))
        if chosen and gains[top] < NEWS:
            break
        seen = np.maximum(seen, shares[top])
        chosen.append(cuts[top])
    return chosen


def trial(
    spec: mujoco.MjSpec, recordings: Sequence[Recording], fixed: Sequence[Fixed] = ()
) -> list[np.ndarray]:
    """Return what encoders would say when they are read in replays side by side, (T, nq) each."""
    if not recordings:
        return []
    plant_spec, dt = switchable(spec), spec.option.timestep
    plans = [schedule(recording, dt) for recording in recordings]
    width = len(recordings[0].qpos) + recordings[0].ctrl.shape[1]
    size = len(plans) * max(plan.steps for plan in plans) * width * BYTES  # bytes
    paths: list[np.ndarray] = []
    for chunk in np.array_split(np.arange(len(plans)), int(np.ceil(size / LARGEST))):
        plant = Plant(plant_spec, num_rows=len(chunk), fixed=fixed)
        motion = simulate(plant, [plans[i] for i in chunk])
        paths += [motion.at_rows(k, recordings[i]) for k, i in enumerate(chunk)]
    return paths
