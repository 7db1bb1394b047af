"""How hot motors are when a window starts, so that heat need not be replayed from the beginning.

    heat = Heat(data)
    heat.start(plant, windows)          # after a reset

Under `thermal_derating` a motor's strength falls with the integral of its squared torque. Up to the
window's first row the torque follows from the log itself: the actuator's law at the measured
position, weakened as it then was.
"""

from __future__ import annotations

import numpy as np

from envs.effects.supply import _Derating
from envs.plant import Plant
from sim2real.diagnosis.data import Data
from sim2real.replay import to_recording


class Heat:
    """The motors' torques of whole logs."""

    def __init__(self, data: Data) -> None:
        self._data = data
        self._torques: dict[int, np.ndarray] = {}  # by log, (T, nu) N·m

    def start(self, plant: Plant, windows: np.ndarray) -> None:
        """Warm the motors of a plant whose rows replay these windows, (R,)."""
        for rule in plant.substep_rules:
            if isinstance(rule, _Derating):
                rule.heat[:] = self._at(rule, windows)

    def _at(self, rule: _Derating, windows: np.ndarray) -> np.ndarray:
        """Return the heat of the rule's motors, (R, k) N²·m²·s."""
        parts = [self._before(int(w), rule.index) for w in windows]
        longest = max(len(square) for _, square in parts)
        heat = np.zeros((len(windows), len(rule.index)))
        spans = np.zeros((len(windows), longest))
        squares = np.zeros((len(windows), longest, len(rule.index)))
        for row, (span, square) in enumerate(parts):
            spans[row, longest - len(span) :] = span
            squares[row, longest - len(span) :] = square
        for k in range(longest):
            span = spans[:, k : k + 1]
            weak = np.maximum(1.0 - rule.value * heat, 0.0)
            heat = heat * np.exp(-rule.decay * span) + weak**2 * squares[:, k] * span
        return heat

    def _before(self, window: int, actuators: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of the episode before a window: their lengths [s] and squared torques."""
        one = self._data.windows[window]
        log = self._data.logs[one.log]
        first = int(np.argmax(log.episode == one.episode))
        rows = slice(first, one.start)
        square = self._torque(one.log)[rows][:, actuators] ** 2
        return np.diff(log.time[first : one.start + 1]), square

    def _torque(self, number: int) -> np.ndarray:
        """Return the torque that the law makes of each row of a log, (T, nu) N·m."""
        if number in self._torques:
            return self._torques[number]
        log = self._data.logs[number]
        model = self._data.models[next(w.model for w in self._data.windows if w.log == number)]
        recording = to_recording(log, model)
        found = np.zeros((len(log), model.nu))
        for i in range(model.nu):
            name = model.joint(int(model.actuator_trnid[i, 0])).name
            if f"qpos.{name}" not in log.columns:
                continue
            q, gear = log.columns[f"qpos.{name}"], float(model.actuator_gear[i, 0])
            speed = np.gradient(q, log.time)
            bias = model.actuator_biasprm[i]
            force = model.actuator_gainprm[i, 0] * recording.ctrl[:, i] + bias[0]
            force = force + bias[1] * gear * q + bias[2] * gear * speed
            if model.actuator_forcelimited[i]:
                force = np.clip(force, *model.actuator_forcerange[i])
            torque = force * gear - model.actuator_damping[i] * gear**2 * speed
            on = np.ones(len(log), bool) if recording.powered is None else recording.powered[:, i]
            found[:, i] = np.where(on, torque, 0.0)
        self._torques[number] = found
        return found
