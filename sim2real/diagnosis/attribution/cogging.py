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

COUNTS = range(4, 33)  # ripples in a turn
BEST = 3  # counts that are looked at
SIZES = (1.0, 2.5)  # times the amplitude that the error shows: in motion it shows too little
SLOW = 0.7  # rad/s (or m/s): faster rows say little
TURNED = 0.8  # rad (or m): a joint that turned less shows no more than a slope
LEAST = 0.1  # N·m/rad: the stiffness of a servo whose model does not say


def with_ripples(candidate: Candidate, data: Data, error: np.ndarray) -> Candidate:
    """Return a ripple's candidate whose probes are the counts, sizes and phases in the error.

    Args:
        candidate: a `cogging`; its parameters are amplitude [N·m], count and phase [rad].
        data: the windows.
        error: simulated minus measured, (W, T, M), over the joints' scale.
    """
    joint = next(i for i, j in enumerate(data.joints) if j.name == candidate.joint)
    inside = data.mask & _slow(data, joint)
    q, rest = data.measured[..., joint][inside], error[..., joint][inside] * data.scale[joint]
    if len(q) < 50:
        return candidate
    found = []
    smooth = q[:, None] ** np.arange(4 if np.ptp(q) > TURNED else 1)
    for count in COUNTS:
        table = np.column_stack([smooth, np.sin(count * q), np.cos(count * q)])
        weights, *_ = np.linalg.lstsq(table, rest)
        left = float(((rest - table @ weights) ** 2).sum())
        found.append((left, count, complex(-weights[-2], -weights[-1])))
    found.sort(key=lambda one: one[0])
    stiff = _stiffness(candidate, data)
    probes = [
        (size * stiff * abs(wave), float(count), float(np.angle(wave)))
        for _, count, wave in found[:BEST]
        for size in SIZES
    ]
    return replace(candidate, probes=np.clip(probes, candidate.low, candidate.high))


def _slow(data: Data, joint: int) -> np.ndarray:
    """Return the rows at which a joint is slow and its servo on, (W, T)."""
    found = np.zeros(data.mask.shape, bool)
    for row, window in zip(found, data.windows, strict=True):
        if window.off < 0.05 and len(window.sample) > 1:
            speed = np.gradient(window.measured[:, joint], window.sample[:, joint])
            row[: len(speed)] = np.abs(speed) < SLOW
    return found


def _stiffness(candidate: Candidate, data: Data) -> float:
    """Return the stiffness of the servo at a candidate's joint [N·m/rad]."""
    model = data.models[0]
    place = model.joint(candidate.joint).id
    for i in range(model.nactuator):
        if int(model.actuator_trnid[i, 0]) == place:
            gear = float(model.actuator_gear[i, 0])
            return max(float(-model.actuator_biasprm[i, 1]) * gear * gear, LEAST)
    return LEAST
