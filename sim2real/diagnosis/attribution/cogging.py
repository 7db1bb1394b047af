"""Where a ripple of the torque with a joint's angle may be: counts and phases seen in the error.

    tuned = with_ripples(candidate, data, error)        # its probes are what the error shows

A servo that a torque tau pushes gives way by tau / kp, so a ripple A sin(N q + phase) that the
model lacks shows in the error, simulated minus measured, as -A/kp sin(N q + phase) while it is
slow. For each N of a grid the sine and cosine of N q are fitted to it beside a smooth function of
q: a least-squares periodogram (Lomb 1976, Astrophysics and Space Science 39), whose highest peaks
are looked at first. N need not be whole: a gear of 298.5 : 1 makes no whole number of the motor's
poles. The grid is as fine as the joint's span lets it be, and ends where the encoder no longer
resolves a ripple.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY
from sim2real.diagnosis.settings.attribution import Cogging


def with_ripples(candidate: Candidate, data: Data, error: np.ndarray) -> Candidate:
    """Return a ripple's candidate whose probes are the counts, sizes and phases in the error.

    Args:
        candidate: a `cogging`; its parameters are amplitude [N·m], count and phase [rad].
        data: the windows.
        error: simulated minus measured, (W, T, M), over the joints' scale.
    """
    joint = next(i for i, j in enumerate(data.joints) if j.name == candidate.joint)
    limits = data.settings.cogging
    inside = data.mask & _slow(data, joint)
    q, rest = data.measured[..., joint][inside], error[..., joint][inside] * data.scale[joint]
    if len(q) < limits.rows_min:
        return candidate
    order = limits.trend_order if np.ptp(q) > limits.turned else 0
    smooth, _ = np.linalg.qr(q[:, None] ** np.arange(order + 1))  # (rows, order + 1)
    rest = rest - smooth @ (smooth.T @ rest)
    counts = _grid(q, data.joints[joint].count, limits)
    if not counts.size:
        return candidate
    waves = np.array([_wave(q, rest, smooth, count) for count in counts])  # (N, 3)
    stiff = _stiffness(candidate, data)
    probes = [
        (size * stiff * np.hypot(*waves[k, :2]), counts[k], np.arctan2(waves[k, 1], waves[k, 0]))
        for k in _peaks(waves[:, 2])[: limits.counts_probed]
        for size in limits.sizes
    ]
    return replace(candidate, probes=np.clip(probes, candidate.low, candidate.high))


def _grid(q: np.ndarray, step: float, limits: Cogging) -> np.ndarray:
    """Return the counts to look at, (N,): `limits.finest` of them in a resolvable difference."""
    fewest, most = limits.counts
    apart = 2 * np.pi / max(float(np.ptp(q)), TINY)  # of counts that the span tells apart
    if step > 0:
        most = min(most, np.pi / (limits.readings * step))
    return np.arange(max(fewest, apart), most, apart / limits.finest)


def _wave(q: np.ndarray, rest: np.ndarray, smooth: np.ndarray, count: float) -> np.ndarray:
    """Return minus the sine's and cosine's parts of an error, and the squares they remove, (3,)."""
    table = np.column_stack([np.sin(count * q), np.cos(count * q)])
    table -= smooth @ (smooth.T @ table)
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


def _stiffness(candidate: Candidate, data: Data) -> float:
    """Return the stiffness of the servo at a candidate's joint [N·m/rad]."""
    model, least = data.models[0], data.settings.cogging.stiffness_min
    place = model.joint(candidate.joint).id
    for i in range(model.nactuator):
        if int(model.actuator_trnid[i, 0]) == place:
            gear = float(model.actuator_gear[i, 0])
            return max(float(-model.actuator_biasprm[i, 1]) * gear * gear, least)
    return least
