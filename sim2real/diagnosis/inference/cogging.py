"""Where a ripple of the torque with a joint's angle may be: counts and phases seen in the error.

    tuned = with_ripples(candidate, data, error)        # its probes are what the error shows

A servo that a torque tau pushes gives way by tau / kp, so a ripple A sin(N q + phase) that the
model lacks shows in the error, simulated minus measured, as -A/kp sin(N q + phase) while it is
slow. For each N of a grid the sine and cosine of N q are fitted to it with a straight line in q,
which a wrong zero or stiffness shows: a least-squares periodogram (Lomb 1976, Astrophysics and
Space Science 39), whose highest peaks are looked at first. N need not be whole: a gear of 298.5 : 1
makes no whole number of the motor's poles. The grid is as fine as the joint's span lets it be.

A joint that no servo holds is moved instead: over a window, the ripple's torque shows as its double
integral over the inertia, at any speed, with those of a constant torque and of a viscous one.
Neither holds in a window that is without torque for a while.
"""

from dataclasses import replace

import mujoco
import numpy as np
from scipy.signal import find_peaks

from envs.effects.places import joint_driven
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.settings import TINY


def with_ripples(candidate: Candidate, data: Data, error: np.ndarray) -> Candidate:
    """Return a ripple's candidate whose probes are the counts, sizes and phases in the error.

    Args:
        candidate: a `cogging`; its parameters are amplitude [N·m], count and phase [rad].
        data: the windows.
        error: simulated minus measured, (W, T, M), over the joints' scale.
    """
    name, limits, model = str(candidate.joint), data.settings.cogging, data.models[0]
    number, own = [joint.name for joint in data.joints].index(name), model.joint(name)
    q, steps = np.nan_to_num(data.measured[..., number]), _steps(data, number)  # (W, T)
    speed = np.divide(np.diff(q, prepend=q[:, :1]), steps, out=np.zeros(q.shape), where=steps > 0)
    stiffness, inertia = _stiffness(model, own.id), float(model.dof_M0[own.dofadr[0]])
    held = stiffness > 0
    inside = data.mask & np.array([[window.off == 0] for window in data.windows])
    if held:
        inside &= np.abs(speed) < limits.slow

    def shown(*torques: np.ndarray) -> np.ndarray:
        """Return the motion that torques (W, T) cause, up to a factor, (rows, n)."""
        if not held:
            gained = (np.cumsum(torque * steps, axis=1) for torque in torques)
            torques = tuple(np.cumsum(one * steps, axis=1) for one in gained)
        return np.column_stack([torque[inside] for torque in torques])

    span = float(np.ptp(q[inside])) if inside.any() else 0.0
    apart = 2 * np.pi / max(span, TINY)  # of counts that the span resolves
    counts = np.arange(max(candidate.low[1], apart), limits.count_max, apart / limits.finest)
    if not counts.size:
        return candidate
    trend = np.linalg.qr(shown(np.ones(q.shape), q if held else speed))[0]
    rest = _without(trend, error[..., number][inside] * data.scale[number])
    tables = (_without(trend, shown(np.sin(n * q), np.cos(n * q))) for n in counts)
    waves = np.array([_wave(table, rest) for table in tables])  # (N, 3)
    high = find_peaks(np.pad(waves[:, 2], 1, constant_values=-1.0))[0] - 1
    best = high[np.argsort(-waves[high, 2])][: limits.counts_probed]
    unit = stiffness if held else inertia
    probes = [
        (size * unit * np.hypot(*waves[k, :2]), counts[k], np.arctan2(waves[k, 1], waves[k, 0]))
        for k in best
        for size in limits.sizes
    ]
    return replace(candidate, probes=np.clip(probes, candidate.low, candidate.high))


def _without(trend: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return what is left of values (rows, ...) without a trend of orthonormal columns."""
    return values - trend @ (trend.T @ values)


def _wave(table: np.ndarray, rest: np.ndarray) -> tuple[float, float, float]:
    """Return minus the sine's and cosine's parts of an error, and the squares they remove."""
    sine, cosine = np.linalg.lstsq(table, rest)[0]
    return -sine, -cosine, float(rest @ table @ (sine, cosine))


def _steps(data: Data, joint: int) -> np.ndarray:
    """Return the time since a joint was read before, (W, T) s; 0 where it was not read again."""
    found = np.zeros(data.mask.shape)
    for row, window in zip(found, data.windows, strict=True):
        row[1 : len(window.sample)] = np.diff(window.sample[:, joint])
    return found


def _stiffness(model: mujoco.MjModel, joint: int) -> float:
    """Return the stiffness of the servos at a joint [N·m/rad]; 0 without one."""
    drives = range(model.nactuator)
    own = [i for i in drives if joint_driven(model, i) and model.actuator_trnid[i, 0] == joint]
    return -float((model.actuator_biasprm[own, 1] * model.actuator_gear[own, 0] ** 2).sum())
