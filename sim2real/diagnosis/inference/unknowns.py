"""What is unknown of windows in addition to their noise: starts, clocks, time steps, usual errors.

    local, common = compute_unknowns(replayer, coarse, hypothesis, values)

Each is one standard deviation of what it does to the errors, by finite differences under a
hypothesis. A robot's clock and its model's differ by part of a time step, by chance in each window
and by as much in all of them. A robot has no time steps: to first order, what a model's makes is
twice what half of it changes (Richardson 1911, doi:10.1098/rsta.1911.0009); where joints stick or
ring, it is another in each window. Where a replay is further off than joints that stay, straight
lines through it mean nothing: starts are then taken to move on freely, and no error of a parameter
counts as usual.
"""

import numpy as np

from sim2real.diagnosis.data.noise_floor import rounding
from sim2real.diagnosis.inference.fit import Fitter
from sim2real.diagnosis.inference.hypotheses import NONE, Hypothesis
from sim2real.diagnosis.inference.likelihood import Basis, Likelihood
from sim2real.diagnosis.inference.replayer import Job, Replayer

FAINT = 0.1


def compute_unknowns(
    replayer: Replayer, coarse: Replayer, hypothesis: Hypothesis, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the directions of what is unknown around the errors under values (W, P).

    Those of a window alone, (W, N, M, L), and those common to all, (W, N, M, U); `coarse` replays
    the same windows for them.
    """
    job = Job(hypothesis, values, replayer.every)
    (base,) = replayer.replay([job])
    if is_lost(replayer, base.error):
        none = np.zeros((*base.error.shape, 0))
        return cap_directions(replayer, replayer.ballistic()), none
    step = max(model.opt.timestep for model in replayer.data.models)
    clock = rounding(step) * base.slope[..., None]  # a command acts at the next step
    stepping = estimate_step_error(replayer, job, base.error)[..., None]
    starts = coarse.starts(hypothesis, values)
    local = np.concatenate([starts, clock, stepping, replayer.estimated], axis=-1)
    usual = coarse.usual(hypothesis, values)
    common = _largest(replayer, np.concatenate([usual, clock], axis=-1))
    return _principal(replayer, cap_directions(replayer, local)), cap_directions(replayer, common)


def estimate_step_error(replayer: Replayer, job: Job, error: np.ndarray) -> np.ndarray:
    """Return what no time step at all would add to a job's error, (W, N, M), to first order."""
    (halved,) = replayer.halved.replay([job])
    return 2 * (halved.error - error)


def make_fitter(
    replayer: Replayer,
    coarse: Replayer,
    fold: np.ndarray,
    hypothesis: Hypothesis,
    values: np.ndarray,
    basis: Basis | None = None,
) -> tuple[Fitter, np.ndarray, np.ndarray]:
    """Return what fits with the unknowns under values (2, P) of the folds, and these.

    See `compute_unknowns`; a known basis of the windows' rows is not computed again.
    """
    local, common = compute_unknowns(replayer, coarse, hypothesis, values[fold])
    rows = replayer.times, replayer.used, replayer.noise
    likelihood = Likelihood(*rows, local, common, replayer.settings, basis)
    return Fitter(replayer, likelihood, fold, coarse), local, common


def is_lost(replayer: Replayer, errors: np.ndarray) -> bool:
    """Return whether errors (W, N, M) are larger than those of joints that stay."""
    return bool(np.square(errors).sum() > np.square(replayer.holding()).sum())


def coarsen(replayer: Replayer, given: np.ndarray, windows: np.ndarray) -> Replayer:
    """Return a replayer of some windows, (n,), in longer time steps where these change little.

    What they change of the model as given, whose errors are `given`, (W, N, M), is taken off all
    errors. That is no correction where a model is lost, nor where it is large: an effect changes
    it, too.
    """
    if is_lost(replayer, given):
        return replayer.part(windows)
    other, none = replayer.coarsen(windows), np.zeros((len(windows), 0))
    (made,) = other.replay([Job(NONE, none, other.every)])
    changed = ((made.error - given[windows]) / replayer.noise)[other.used]
    much = np.sqrt(np.mean(np.square(changed))) > replayer.settings.coarse_noises
    return replayer.part(windows) if much else other


def cap_directions(replayer: Replayer, ways: np.ndarray) -> np.ndarray:
    """Return changes of errors (W, N, M, D), none beyond the spread of a joint's motion.

    Where a replay flies off, straight lines through it say more than there is room for.
    """
    data = replayer.data
    reach = np.array([joint.spread for joint in data.joints]) / data.scale
    return np.clip(ways, -reach[:, None], reach[:, None])


def _principal(replayer: Replayer, ways: np.ndarray) -> np.ndarray:
    """Return directions (W, N, M, L) of each window as fewer of the same covariance.

    What is left out adds less than `FAINT` to the variance of the noise.
    """
    used = replayer.used[..., None, None]
    flat = np.where(used, ways / replayer.noise[:, None], 0.0).reshape(
        len(ways), -1, ways.shape[-1]
    )
    variance, turned = np.linalg.eigh(flat.mT @ flat)
    kept = turned[..., (variance > FAINT).any(axis=0)]
    return (ways.reshape(flat.shape) @ kept).reshape(*ways.shape[:-1], -1)


def _largest(replayer: Replayer, ways: np.ndarray) -> np.ndarray:
    """Return directions (W, N, M, U) as fewer of about the same covariance."""
    most = replayer.settings.factors_max
    if ways.shape[-1] <= most:
        return ways
    flat = (ways / replayer.noise[:, None])[replayer.used].reshape(-1, ways.shape[-1])
    _, turned = np.linalg.eigh(flat.T @ flat)  # the largest last
    return ways @ turned[:, -most:]
