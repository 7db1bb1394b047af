"""Replaying recorded commands in simulation: what the model would have done in the robot's place.

    plant = Plant(switchable(spec), effects, num_rows=len(recordings))
    paths = replay(plant, recordings)            # (T, nq) each, when positions were read

It is the only replay there is: `run=replay`, every step of a diagnosis, the exam and the plans of
experiments go through it. To replay recordings many times, do it in parts:

    plans = [schedule(recording, dt) for recording in recordings]       # once
    motion = simulate(plant, plans)              # after plant.set_params
    motion.qpos, motion.lost                     # (N, K + 1, nq) at physics steps, (N,) s

Contracts:

* The clock is 0 at the start of a recording. The encoders then say its `qpos`; `held` is the
  command in force until then, which goal generators know for all of the past. Delay lines hold what
  was sent before (`past`), or `held`.
* A command acts at the first physics step not before its time, and holds until the next one does.
* What the encoders say is known at physics steps and linear in between. A recording says when each
  position was read (`read`); before the start there is nothing to read but the start.
* An actuator that is switched off exerts nothing and does not brake.
* A joint under impedance control has the gains of the row in force (`with_impedance`).
* A servo whose derivative gain acts on the error has its goal's part of it (`derivative`).
* The same start, commands and effects give the same positions to the bit, in any row and
  with any others. Rows may repeat a recording, to try many parameters on it side by side.
"""

from envs.replay.engine import (
    DivergedError,
    InterpolationPoints,
    Motion,
    interpolate,
    readings,
    replay,
    simulate,
)
from envs.replay.impedance import with_impedance, without_impedance
from envs.replay.recording import Recording, Schedule, groups, schedule, switchable
from envs.replay.rollout import rollout

__all__ = [
    "DivergedError",
    "InterpolationPoints",
    "Motion",
    "Recording",
    "Schedule",
    "groups",
    "interpolate",
    "readings",
    "replay",
    "rollout",
    "schedule",
    "simulate",
    "switchable",
    "with_impedance",
    "without_impedance",
]
