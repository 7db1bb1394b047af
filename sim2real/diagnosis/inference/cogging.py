"""Where a ripple of the torque with a joint's angle may be: counts and phases seen in the error.

    tuned = with_ripples(candidate, data, error)        # its probes are what the error shows

A servo that a torque tau pushes gives way by tau / kp, so a ripple A sin(N q + phase) that the
model lacks shows in the error, simulated minus measured, as -A/kp sin(N q + phase) while it is
slow. For each N of a grid the sine and cosine of N q are fitted to it with a smooth function of
q: a least-squares periodogram (Lomb 1976, Astrophysics and Space Science 39), whose highest peaks
are looked at first. N need not be whole: a gear of 298.5 : 1 makes no whole number of the motor's
poles. The grid is as fine as the joint's span lets it be, and ends where the encoder no longer
resolves a ripple.

A joint that no servo holds is moved instead: over a window, the ripple's torque shows as its double
integral over the inertia, at any speed, with those of a constant torque and of a viscous one.
"""

from dataclasses import replace

import numpy as np

from envs.effects.places import joint_driven
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.settings import TINY
from sim2real.diagnosis.settings.inference import Cogging


def with_ripples(candidate: Candidate, data: Data, error: np.ndarray) -> Candidate:
    """Return a ripple's candidate whose probes are the counts, sizes and phases in the error.

    Args:
        candidate: a `cogging`; its parameters are amplitude [N·m], count and phase [rad].
        data: the windows.
        error: simulated minus measured, (W, T, M), over the joints' scale.
    """
    joint = next(i for i, j in enumerate(data.joints) if j.name == candidate.joint)
    limits = data.settings.cogging
    stiff = _stiffness(data.joints[joint].name, data)
    inside = data.mask & _on(data) if stiff is None else data.mask & _slow(data, joint)
    q, rest = data.measured[..., joint][inside], error[..., joint][inside] * data.scale[joint]
    if len(q) < limits.rows_min:
        return candidate
    counts = _grid(q, data.joints[joint].count, limits)
    if not counts.size:
        return candidate
    if stiff is None:
        span = _Span(data, joint, inside)
        smooth, show, stiff = (
            np.linalg.qr(span.trend())[0],
            span,
            _inertia(data.joints[joint].name, data),
        )
    else:
        order = limits.trend_order if np.ptp(q) > limits.turned else 0
        smooth, show = np.linalg.qr(q[:, None] ** np.arange(order + 1))[0], _Still(q)
    rest = rest - smooth @ (smooth.T @ rest)
    waves = np.array([_wave(show(count), rest, smooth) for count in counts])  # (N, 3)
    probes = [
        (size * stiff * np.hypot(*waves[k, :2]), counts[k], np.arctan2(waves[k, 1], waves[k, 0]))
        for k in _peaks(waves[:, 2])[: limits.counts_probed]
        for size in limits.sizes
    ]
    return replace(candidate, probes=np.clip(probes, candidate.low, candidate.high))


class _Still:
    """What a ripple does to a joint that its servo holds: it gives way in proportion."""

    def __init__(self, q: np.ndarray) -> None:
        self._q = q

    def __call__(self, count: float) -> np.ndarray:
        """Return the sine's and the cosine's part for a count, (rows, 2)."""
        return np.column_stack([np.sin(count * self._q), np.cos(count * self._q)])


class _Span:
    """What a ripple does to a joint that nothing holds: double integrals over each window."""

    def __init__(self, data: Data, joint: int, inside: np.ndarray) -> None:
        self._inside, self._q = inside, np.nan_to_num(data.measured[..., joint])
        self._steps = np.zeros(self._q.shape)  # (W, T) s since the row before
        for row, time in zip(self._steps, data.times(), strict=True):
            row[1 : len(time)] = np.diff(time)

    def __call__(self, count: float) -> np.ndarray:
        """Return the sine's and the cosine's part for a count, (rows, 2)."""
        return self._twice(np.sin(count * self._q), np.cos(count * self._q))

    def trend(self) -> np.ndarray:
        """Return what a constant torque and one in proportion to the speed do, (rows, 2)."""
        moved = self._q - self._q[:, :1]
        return np.column_stack([self._twice(np.ones(self._q.shape)), self._once(moved)])

    def _once(self, values: np.ndarray) -> np.ndarray:
        return np.cumsum(np.where(self._inside, values, 0.0) * self._steps, axis=1)[self._inside]

    def _twice(self, *values: np.ndarray) -> np.ndarray:
        gained = [np.cumsum(one * self._steps, axis=1) for one in values]
        return np.column_stack([self._once(one) for one in gained])


def _grid(q: np.ndarray, step: float, limits: Cogging) -> np.ndarray:
    """Return the counts to look at, (N,): `limits.finest` of them in a resolvable difference."""
    fewest, most = limits.counts
    apart = 2 * np.pi / max(float(np.ptp(q)), TINY)  # of counts that the span resolves
    if step > 0:
        most = min(most, np.pi / (limits.readings * step))
    return np.arange(max(fewest, apart), most, apart / limits.finest)


def _wave(table: np.ndarray, rest: np.ndarray, smooth: np.ndarray) -> np.ndarray:
    """Return minus the sine's and cosine's parts of an error, and the squares they remove, (3,)."""
    table = table - smooth @ (smooth.T @ table)
    weights, *_ = np.linalg.lstsq(table, rest)
    return np.array([*-weights, float(rest @ table @ weights)])


def _peaks(height: np.ndarray) -> np.ndarray:
    """Return the places of a curve's local maxima, the highest first."""
    padded = np.concatenate([[-np.inf], height, [-np.inf]])
    found = np.flatnonzero((height >= padded[:-2]) & (height > padded[2:]))
    return found[np.argsort(-height[found])]


def _slow(data: Data, joint: int) -> np.ndarray:
    """Return the rows at which a joint is slow and its servo on, (W, T)."""
    found = np.zeros(data.mask.shape, bool)
    for row, window in zip(found, data.windows, strict=True):
        if window.off < data.settings.cogging.off_share and len(window.sample) > 1:
            with np.errstate(divide="ignore", invalid="ignore"):  # a lost answer keeps its stamp
                speed = np.gradient(window.measured[:, joint], window.sample[:, joint])
            row[: len(speed)] = np.abs(speed) < data.settings.cogging.slow
    return found


def _on(data: Data) -> np.ndarray:
    """Return the rows of windows under torque, (W, 1)."""
    share = data.settings.cogging.off_share
    return np.array([[window.off < share] for window in data.windows])


def _stiffness(joint: str, data: Data) -> float | None:
    """Return the stiffness of the servo at a joint [N·m/rad]; None without a servo."""
    model, least = data.models[0], data.settings.cogging.stiffness_min
    place = model.joint(joint).id
    for i in range(model.nactuator):
        if joint_driven(model, i) and int(model.actuator_trnid[i, 0]) == place:
            gear, held = float(model.actuator_gear[i, 0]), float(-model.actuator_biasprm[i, 1])
            return max(held * gear * gear, least) if held else None
    return None


def _inertia(joint: str, data: Data) -> float:
    """Return what has to be moved at a joint in the model's pose [kg·m²]."""
    model = data.models[0]
    return float(model.dof_M0[int(model.joint(joint).dofadr[0])])
