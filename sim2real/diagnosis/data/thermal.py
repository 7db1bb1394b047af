"""How hot motors are when a window starts, so that heat need not be replayed from the beginning.

    heat = Heat(data, paths)            # paths(log, strengths): positions that a model takes
    heat.start(plant, windows)          # after a reset

Under `thermal_derating` a motor's strength falls with the integral of its squared torque. Up to the
window's first row the torque is the one that it takes to follow the log's commands, window by
window, between those of motors of several strengths: a load that is held takes the same torque
from a weak motor, a swing less by the square, and a motor that gives way heats no more. (The
servo's law at the measured position is no way to it: readings are milliseconds from the commands
that they are subtracted from, and a stiff gain makes torques of that.)

Where several motors weaken and one gives way, the others' load is another one: an arm that hangs
down turns more easily. Their torques change by as much as they do in simulations of the windows
with the strengths that were found for them.
"""

from collections.abc import Callable, Iterable

import mujoco
import numpy as np

from envs.effects.places import joint_driven
from envs.effects.supply import _Derating
from envs.plant import Plant
from envs.replay import Schedule
from envs.replay.impedance import impedances
from envs.replay.recording import ROUNDING
from sim2real.diagnosis.data.dataset import Data, Window
from sim2real.diagnosis.data.recording import powered
from sim2real.diagnosis.settings import TINY_SQUARE

HEAT_STEP = 0.05  # s: time step of the integral, far below the minutes in which motors heat
Path = tuple[mujoco.MjModel, np.ndarray, Schedule, np.ndarray]
Paths = Callable[[int, np.ndarray], Iterable[Path]]


class Heat:
    """The motors' squared torques along whole logs.

    Args:
        data: the windows.
        paths: of a log's number and of its windows' motors' strengths (W, nu); returns, of each of
            the log's windows in turn, the model with its actuators as they were simulated, the
            positions at the steps of the simulation (K + 1, nq), what was asked for there (K steps)
            and whether motors are on (K, nu).
    """

    def __init__(self, data: Data, paths: Paths) -> None:
        self._data, self._paths = data, paths
        self._strengths = data.settings.simulation.strengths
        self._nodes = np.array([0.0, *self._strengths[::-1], 1.0]) ** 2  # (S + 1,)
        self._places = np.array([(window.log, window.start) for window in data.windows])  # (W, 2)
        self._known: dict[tuple[int, int | None], np.ndarray] = {}  # (S, 2, T, nu) N²·m²

    def start(self, plant: Plant, windows: np.ndarray) -> None:
        """Warm the motors of a plant whose rows replay these windows, (R,), where heat counts."""
        for rule in plant.substep_rules:
            if isinstance(rule, _Derating) and (rows := np.flatnonzero(rule.value)).size:
                rule.heat[rows] = self._at(rule, rows, windows[rows])

    def learn(self, windows: np.ndarray, actuators: np.ndarray) -> None:
        """Work out what `start` needs for windows (R,) and motors (k,), once for all processes."""
        for log in np.unique(self._places[windows, 0]).tolist():
            for weak in (None, *actuators.tolist()):
                self._tables(log, weak)

    def _at(self, rule: _Derating, rows: np.ndarray, windows: np.ndarray) -> np.ndarray:
        """Return the heat of the rule's motors in some rows (n,), (n, k) N²·m²·s."""
        own = np.column_stack([rule.value[rows], rule.decay[rows], rule.braking[rows]])
        logs, starts = self._places[windows].T
        heat = np.zeros((len(windows), len(rule.index)))
        for log in np.unique(logs):
            here = logs == log
            points, which = np.unique(own[here], axis=0, return_inverse=True)
            heat[here] = self._along(int(log), rule.index, points)[starts[here], which.ravel()]
        return heat

    def _along(self, number: int, motors: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the heat of motors (k,) at a log's rows, (T, G, k) N²·m²·s.

        `points` are loss, decay and braking, (G, 3).
        """
        full = self._tables(number)[..., motors]
        part = [self._tables(number, int(motor))[..., motor] for motor in motors]
        both = np.concatenate([np.stack(part, axis=-1), full])  # (S, 2, T, k)
        squares = _spared(both, points)
        heat = self._integral(number, squares, points)
        if len(motors) > 1:
            lost = points[:, 0] * heat.max(axis=(0, 2))
            for point in np.flatnonzero(lost > 1 - self._strengths[0]):
                one, alone = points[point], squares[:, :, point]
                own = alone * self._loads(number, motors, alone, one, heat[:, point])
                heat[:, point, None] = self._integral(number, own[:, :, None], one[None])
        return heat

    def _loads(
        self,
        number: int,
        motors: np.ndarray,
        squares: np.ndarray,
        point: np.ndarray,
        hot: np.ndarray,
    ) -> np.ndarray:
        """Return by which factors squared torques change as the other motors weaken, (T, k)."""
        windows, left = self._windows(number), np.maximum(1.0 - point[0] * hot, 0.0)
        strengths = np.ones((len(windows), self._data.models[windows[0].model].nu))
        pieces = [slice(window.first, window.last) for window in windows]
        for own, rows in zip(strengths, pieces, strict=True):
            own[motors] = left[rows] = left[rows].mean(axis=0)
        both = self._both(number, strengths)[..., motors]
        found = _spared(both[None], point[None])[0, :, 0]
        alone, factors = self._risen(self._rises(squares), left), np.ones(left.shape)
        for rows in pieces:
            least = np.maximum(alone[rows].sum(axis=0), TINY_SQUARE)
            factors[rows] = found[rows].sum(axis=0) / least
        return factors

    def _integral(self, number: int, squares: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the heat at a log's rows, (T, G, k), of squared torques (S, T, G, k)."""
        log = self._data.logs[number]
        fresh = np.diff(log.episode, prepend=np.nan) != 0
        spans = np.where(np.roll(fresh, -1), 0.0, np.diff(log.time, append=log.time[-1]))
        stride = max(round(HEAT_STEP / float(np.median(spans[spans > 0]))), 1)
        starts = np.flatnonzero(fresh | (np.arange(len(log)) % stride == 0))
        made = np.add.reduceat(squares * spans[:, None, None], starts, axis=1)  # N²·m²·s
        value = points[:, :1]
        kept = np.exp(-points[:, 1:2] * np.add.reduceat(spans, starts))  # (G, blocks)
        rises = self._rises(made)
        heat = np.zeros((len(starts), *squares.shape[2:]))
        for block in range(1, len(starts)):
            if not fresh[starts[block]]:
                before = heat[block - 1]
                left = np.maximum(1.0 - value * before, 0.0)
                added = self._risen(rises[:, block - 1], left)
                heat[block] = before * kept[:, block - 1, None] + added
        return heat[np.searchsorted(starts, np.arange(len(log)), side="right") - 1]

    def _rises(self, squares: np.ndarray) -> np.ndarray:
        """Return how squared torques (S, ...) rise with the square of the strength left."""
        widths = np.diff(self._nodes).reshape(-1, *[1] * (squares.ndim - 1))
        return np.diff(squares, axis=0, prepend=np.zeros_like(squares[:1])) / widths

    def _risen(self, rises: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Return what rises (S, n, k) come to where strength (n, k) is left.

        None left makes no torque; between the nodes squared torques follow the strength's square.
        """
        nodes = self._nodes[:, None, None]
        low, high = nodes[:-1], nodes[1:]
        return (rises * (np.clip(left * left, low, high) - low)).sum(axis=0)

    def squares(self, number: int) -> np.ndarray:
        """Return a log's mean squared torques between its rows, as given, (T, nu) N²·m²."""
        return self._tables(number)[0, 0]

    def _tables(self, number: int, weak: int | None = None) -> np.ndarray:
        """Return mean squared torques between each row and the next, (S, 2, T, nu) N²·m².

        Of torques less the actuators' damping, and of those before it.
        """
        key = (number, weak)
        if key not in self._known:
            windows = self._windows(number)
            strengths = np.ones((len(windows), self._data.models[windows[0].model].nu))
            found = []
            for part in (1.0,) if weak is None else self._strengths[::-1]:
                strengths[:, [] if weak is None else weak] = part
                found.append(self._both(number, strengths))
            self._known[key] = np.stack(found)
        return self._known[key]

    def _windows(self, number: int) -> list[Window]:
        return [window for window in self._data.windows if window.log == number]

    def _both(self, number: int, strengths: np.ndarray) -> np.ndarray:
        """Return the same of windows' motors of some strengths (W, nu), (2, T, nu).

        In rows that no window covers a motor that is on works as hard as in the others on average.
        """
        log, windows = self._data.logs[number], self._windows(number)
        found = np.full((2, len(log), strengths.shape[1]), np.nan)
        paths = self._paths(number, strengths)
        for window, (model, path, plan, on) in zip(windows, paths, strict=True):
            rows = slice(window.first, window.last)
            for damped in (True, False):
                torque = torques(model, path, plan, damped)
                known = on & np.isfinite(torque)  # not that of a simulation that diverged
                square = np.where(known, torque, 0.0) ** 2  # (K, nu)
                ticks = log.time[window.start] + np.arange(len(square)) * model.opt.timestep
                found[int(not damped), rows] = _means(square, ticks, log.time[rows])
        covered, nominal = np.isfinite(found[0]).all(axis=1), self._data.models[windows[0].model]
        on = np.stack([powered(log, nominal.actuator(i).name) for i in range(nominal.nu)], axis=1)
        usual = found[:, covered].sum(axis=1) / np.maximum(on[covered].sum(axis=0), 1)  # (2, nu)
        return np.where(covered[:, None], found, usual[:, None] * on)


def _spared(both: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return squared torques (S, T, G, k), where a part of the damping may be no current."""
    share = points[:, 2:]
    return (1.0 - share) * both[:, 0, :, None] + share * both[:, 1, :, None]


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
