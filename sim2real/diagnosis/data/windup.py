"""What integral action has summed up when a window starts, so that it need not be replayed.

    windup = Windup(data)
    windup.start(plant, windows)        # after a reset

A servo's integral remembers all errors of an episode: ∫ (command - position) dt, frozen while its
force is at its limit (Åström and Hägglund, PID Controllers, 1995, section 3.5). Commands and
positions are in the log, so that its rows tell what the integral is at any moment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.effects.drive import _Integral
from envs.plant import Plant
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.poses import positions
from sim2real.diagnosis.data.recording import episode_rows, powered
from sim2real.diagnosis.settings import TINY

BLOCK = 0.01  # s: time step of the integral, far below the tenths of a second in which it acts


class _Servo(NamedTuple):
    """A servo's law in G rows of a plant, (G,) each."""

    rate: np.ndarray  # of the integral action [1/s]
    first: np.ndarray  # integral at the start of an episode [rad s]
    gain: np.ndarray
    held: np.ndarray  # force at position 0
    stiff: np.ndarray  # force per position
    drag: np.ndarray  # force per speed
    low: np.ndarray  # limits of the force
    high: np.ndarray
    delay: np.ndarray  # of the commands [s]


class Windup:
    """The integrals of servos along whole logs."""

    def __init__(self, data: Data) -> None:
        self._data = data

    def start(self, plant: Plant, windows: np.ndarray) -> None:
        """Wind up the servos of a plant whose rows replay these windows, (R,)."""
        for rule in plant.substep_rules:
            if isinstance(rule, _Integral) and (rows := np.flatnonzero(rule.value)).size:
                for place, actuator in enumerate(rule.index.tolist()):
                    own = rule.value[rows], rule.first(rows), *_law(plant, rows, actuator)
                    servos = np.column_stack(own)
                    rule.sum[rows, place] = self._at(servos, actuator, windows[rows])

    def _at(self, servos: np.ndarray, actuator: int, windows: np.ndarray) -> np.ndarray:
        """Return the integrals of an actuator under laws (n, 9) when windows (n,) start, (n,)."""
        found, own = np.zeros(len(windows)), [self._data.windows[window] for window in windows]
        places = np.array([(window.log, window.start) for window in own])
        for log in np.unique(places[:, 0]).tolist():
            here = places[:, 0] == log
            laws, which = np.unique(servos[here], axis=0, return_inverse=True)
            integrals = self._along(log, actuator, _Servo(*laws.T))
            found[here] = integrals[places[here, 1], which.ravel()]
        return found

    def _along(self, number: int, actuator: int, servo: _Servo) -> np.ndarray:
        """Return the integrals of an actuator at a log's rows, (T, G) [rad s]."""
        log = self._data.logs[number]
        model = self._data.models[next(w.model for w in self._data.windows if w.log == number)]
        joint, name = int(model.actuator_trnid[actuator, 0]), model.actuator(actuator).name
        names = {place: name for name, place in positions(log, model).items()}
        own, found = names.get(int(model.jnt_qposadr[joint])), np.tile(servo.first, (len(log), 1))
        if own is None or f"ctrl.{name}" not in log.columns:
            return found  # no error is known of what was not logged
        ctrl, there = log.column(f"ctrl.{name}"), log.column(f"qpos.{own}")
        there, on = float(model.actuator_gear[actuator, 0]) * there, powered(log, name)
        for rows in episode_rows(log):
            found[rows] = _sum_up(servo, log.time[rows], ctrl[rows], there[rows], on[rows])
        return found


def _law(plant: Plant, rows: np.ndarray, actuator: int) -> list[np.ndarray]:
    """Return an actuator's law in rows of a plant, but for its integral action; see `_Servo`."""
    fields = []
    for name in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "actuator_delay"):
        own, every = getattr(plant.model, name)[actuator], plant.batch.expanded(name)
        alike = np.broadcast_to(own, (len(rows), *np.shape(own)))
        fields.append(alike if every is None else every[rows, actuator])
    gain, bias, limits, delay = fields
    return [gain[:, 0], *bias[:, :3].T, *limits.T, delay]


def _sum_up(
    servo: _Servo, time: np.ndarray, ctrl: np.ndarray, position: np.ndarray, on: np.ndarray
) -> np.ndarray:
    """Return the integrals at the rows of an episode, (T, G), each of the others (T,)."""
    edges = time[0] + BLOCK * np.arange(int((time[-1] - time[0]) / BLOCK + TINY) + 2)
    sent = np.append(0.0, np.cumsum(ctrl[:-1] * np.diff(time)))  # the integral of the command
    late = edges[:, None] - servo.delay  # (B + 1, G)
    asked = np.interp(late, time, sent) + ctrl[0] * np.minimum(late - time[0], 0.0)
    there = np.interp(edges, time, position)
    pull = servo.held + servo.stiff * ((there[1:] + there[:-1]) / 2)[:, None]
    error = np.diff(asked, axis=0) / BLOCK + pull / np.where(servo.gain > 0, servo.gain, 1.0)
    steps, damper = BLOCK * error, servo.drag * (np.diff(there) / BLOCK)[:, None]
    runs = on[np.searchsorted(time, edges[:-1] + TINY, side="right") - 1]
    total = servo.first + np.concatenate([np.zeros((1, len(servo.rate))), np.cumsum(steps, axis=0)])
    if not runs.all() or _is_frozen(servo, total[:-1], error, damper).any():
        for block, running in enumerate(runs):
            stuck = _is_frozen(servo, total[block], error[block], damper[block])
            total[block + 1] = running * (total[block] + np.where(stuck, 0.0, steps[block]))
    return np.stack([np.interp(time, edges, own) for own in total.T], axis=-1)


def _is_frozen(
    servo: _Servo, total: np.ndarray, error: np.ndarray, damper: np.ndarray
) -> np.ndarray:
    """Return where the force is at its limit and the error would drive it further, (..., G)."""
    force = servo.gain * (error + servo.rate * total) + damper
    return ((force >= servo.high) & (error > 0)) | ((force <= servo.low) & (error < 0))
