"""Where a ripple of the torque with a joint's angle may be: counts and phases seen in the error.

    tuned = with_ripples(candidate, data, error)        # its probes are what the error shows

A servo that a torque tau pushes gives way by tau / kp, so a ripple A sin(N q + phase) that the
model lacks shows in the error, simulated minus measured, as -A/kp sin(N q + phase) while it is
slow. For each whole N the sine and cosine of N q are fitted to it beside a smooth function of q;
those N that remove most are looked at first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.data.dataset import Data


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
    found = []
    order = limits.trend_order if np.ptp(q) > limits.turned else 0
    smooth = q[:, None] ** np.arange(order + 1)
    fewest, most = limits.counts
    for count in range(fewest, most + 1):
        table = np.column_stack([smooth, np.sin(count * q), np.cos(count * q)])
        weights, *_ = np.linalg.lstsq(table, rest)
        left = float(((rest - table @ weights) ** 2).sum())
        found.append((left, count, complex(-weights[-2], -weights[-1])))
    found.sort(key=lambda one: one[0])
    stiff = _stiffness(candidate, data)
    probes = [
        (size * stiff * abs(wave), float(count), float(np.angle(wave)))
        for _, count, wave in found[: limits.counts_probed]
        for size in limits.sizes
    ]
    return replace(candidate, probes=np.clip(probes, candidate.low, candidate.high))


def _slow(data: Data, joint: int) -> np.ndarray:
    """Return the rows at which a joint is slow and its servo on, (W, T)."""
    found = np.zeros(data.mask.shape, bool)
    for row, window in zip(found, data.windows, strict=True):
        if window.off < data.settings.cogging.off_share and len(window.sample) > 1:
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
