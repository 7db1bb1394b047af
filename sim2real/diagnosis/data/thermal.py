"""How hot motors are when a window starts, so that heat need not be replayed from the beginning.

    heat = Heat(data, paths)            # paths(windows): positions that the model as given takes
    heat.start(plant, windows)          # after a reset

Under `thermal_derating` a motor's strength falls with the integral of its squared torque. Up to the
window's first row the torque is the one that it takes to follow the log's commands, window by
window, between those of motors of several strengths: a load that is held takes the same torque
from a weak motor, a swing less by the square, and a motor that gives way heats no more. (The
servo's law at the measured position is no way to it: readings are milliseconds from the commands
that they are subtracted from, and a stiff gain makes torques of that.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import mujoco
import numpy as np

from envs.effects.places import joint_driven
from envs.effects.supply import _Derating
from envs.plant import Plant
from envs.replay import Schedule
from envs.replay.impedance import impedances
from envs.replay.recording import ROUNDING
from sim2real.diagnosis.data.dataset import Data

Path = tuple[mujoco.MjModel, np.ndarray, Schedule, np.ndarray]
Paths = Callable[[int, int | None, float], Iterable[Path]]


class Heat:
    """The motors' squared torques along whole logs.

    Args:
        data: the windows.
        paths: of a log's number, an actuator or None, and its strength; returns, of each of the
            log's windows in turn, the model with its actuators as they were simulated, the
            positions at the steps of the simulation (K + 1, nq), what was asked for there (K steps)
            and whether motors are on (K, nu).
    """

    def __init__(self, data: Data, paths: Paths) -> None:
        self._data, self._paths = data, paths
        self._strengths = data.settings.simulation.strengths  # below 1, falling
        self._known: dict[tuple[int, int | None], np.ndarray] = {}  # (S, 2, T, nu) N²·m²

    def start(self, plant: Plant, windows: np.ndarray) -> None:
        """Warm the motors of a plant whose rows replay these windows, (R,), where heat counts."""
        for rule in plant.substep_rules:
            if isinstance(rule, _Derating) and (rows := np.flatnonzero(rule.value)).size:
                rule.heat[rows] = self._at(rule, rows, windows[rows])

    def learn(self, windows: np.ndarray, actuators: np.ndarray) -> None:
        """Work out what `start` needs for windows (R,) and motors (k,), once for all processes."""
        for log in sorted({self._data.windows[int(window)].log for window in windows}):
            for weak in (None, *actuators.tolist()):
                self._tables(log, weak)

    def _at(self, rule: _Derating, rows: np.ndarray, windows: np.ndarray) -> np.ndarray:
        """Return the heat of the rule's motors in some rows (n,), (n, k) N²·m²·s."""
        value, decay = rule.value[rows], rule.decay[rows]
        parts = [
            self._before(int(window), rule.index, float(spared))
            for window, spared in zip(windows, rule.braking[rows, 0], strict=True)
        ]
        longest = max(len(span) for span, _ in parts)
        heat = np.zeros((len(windows), len(rule.index)))
        spans = np.zeros((len(windows), longest))
        squares = np.zeros((len(self._strengths) + 2, longest, *heat.shape))
        for row, (span, square) in enumerate(parts):
            spans[row, longest - len(span) :] = span
            squares[1:, longest - len(span) :, row] = square
        nodes = np.array([0.0, *self._strengths[::-1], 1.0]) ** 2  # torque falls by the square
        for k in range(longest):
            left = np.clip(1.0 - value * heat, 0.0, 1.0) ** 2
            above = np.clip(np.searchsorted(nodes, left), 1, len(nodes) - 1)
            low, high = (
                np.take_along_axis(squares[:, k], one[None], 0)[0] for one in (above - 1, above)
            )
            share = (left - nodes[above - 1]) / (nodes[above] - nodes[above - 1])
            span = spans[:, k : k + 1]
            heat = heat * np.exp(-decay * span) + (low + share * (high - low)) * span
        return heat

    def _before(
        self, window: int, actuators: np.ndarray, spared: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of the episode before a window.

        Their lengths [s], (K,), and the squared torques of motors (S, K, k) of each strength, the
        weakest first. A part of their damping may be no current.
        """
        one = self._data.windows[window]
        log = self._data.logs[one.log]
        first = int(np.argmax(log.episode == one.episode))
        rows = slice(first, one.start)
        full = self._tables(one.log)[:, :, rows][..., actuators]
        part = [self._tables(one.log, int(motor))[:, :, rows, motor] for motor in actuators]
        both = np.concatenate([np.stack(part, axis=-1), full])  # (S, 2, K, k)
        square = (1.0 - spared) * both[:, 0] + spared * both[:, 1]
        return np.diff(log.time[first : one.start + 1]), square

    def squares(self, number: int) -> np.ndarray:
        """Return a log's mean squared torques between its rows, as given, (T, nu) N²·m²."""
        return self._tables(number)[0, 0]

    def _tables(self, number: int, weak: int | None = None) -> np.ndarray:
        """Return mean squared torques between each row and the next, (S, 2, T, nu) N²·m².

        Of torques less the actuators' damping, and of those before it.

        Args:
            number: of the log.
            weak: an actuator that has a part of its strength only, the least first; None: the model
                as given, (1, 2, T, nu).
        """
        key = (number, weak)
        if key not in self._known:
            strengths = (1.0,) if weak is None else self._strengths[::-1]
            self._known[key] = np.stack([self._both(number, weak, part) for part in strengths])
        return self._known[key]

    def _both(self, number: int, weak: int | None, strength: float) -> np.ndarray:
        """Return the same of one strength, (2, T, nu)."""
        log = self._data.logs[number]
        windows = [w for w in self._data.windows if w.log == number]
        found = np.zeros((2, len(log), self._data.models[windows[0].model].nu))
        paths = self._paths(number, weak, strength)
        for window, (model, path, plan, on) in zip(windows, paths, strict=True):
            rows = slice(window.first, window.last)
            for damped in (True, False):
                torque = torques(model, path, plan, damped)
                known = on & np.isfinite(torque)  # not that of a simulation that diverged
                square = np.where(known, torque, 0.0) ** 2  # (K, nu)
                ticks = log.time[window.start] + np.arange(len(square)) * model.opt.timestep
                found[int(not damped), rows] = _means(square, ticks, log.time[rows])
        return found


def _means(values: np.ndarray, ticks: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the means (T, n) of values (K, n) at ticks (K,) between moments (T,) and the next."""
    place = np.searchsorted(time, ticks + ROUNDING, side="right") - 1  # (K,)
    values, place = values[place >= 0], place[place >= 0]
    counts = np.bincount(place, minlength=len(time))
    totals = [np.bincount(place, column, minlength=len(time)) for column in values.T]
    return np.stack(totals, axis=-1) / np.maximum(counts, 1)[:, None]


def torques(
    model: mujoco.MjModel, path: np.ndarray, plan: Schedule, damped: bool = True
) -> np.ndarray:
    """Return the torques (K, nu) of affine actuators at joints along positions (K + 1, nq).

    `damped` takes the actuators' own damping off them.
    """
    speed = np.diff(path, axis=0) / model.opt.timestep
    ctrl, own = plan.ctrl, set(impedances(model).tolist())
    found, steps = np.zeros(ctrl.shape), np.arange(len(ctrl))
    for i in range(model.nu):
        if not joint_driven(model, i):
            continue
        joint = int(model.actuator_trnid[i, 0])
        place, gear = int(model.jnt_qposadr[joint]), float(model.actuator_gear[i, 0])
        q, v, bias = path[:-1, place], speed[:, place], model.actuator_biasprm[i]
        sent = np.maximum(steps - round(model.actuator_delay[i] / model.opt.timestep), 0)
        if i in own and plan.law is not None:
            kp, kd, wanted, forward = plan.law[sent, i].T
            force = kp * (ctrl[sent, i] - gear * q) + kd * (wanted - gear * v) + forward
        else:
            force = model.actuator_gainprm[i, 0] * ctrl[sent, i] + bias[0]
            force = force + bias[1] * gear * q + bias[2] * gear * v
        if model.actuator_forcelimited[i]:
            force = np.clip(force, *model.actuator_forcerange[i])
        drag = model.actuator_damping[i] * gear**2 * v
        found[:, i] = force * gear - (drag if damped else 0.0)
    return found
