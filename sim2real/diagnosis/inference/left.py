"""What a fit leaves: what a discrepancy of any size still gains over one of an encoder count.

left = measure_left(fitter, bootstrap, given, fit, windows, most)
left.is_nothing(settings)
"""

from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.inference.fit import Fit, Fitter
from sim2real.diagnosis.inference.score import Bootstrap, Gain
from sim2real.diagnosis.settings import TINY
from sim2real.diagnosis.settings.inference import Inference


class Left(NamedTuple):
    """What a discrepancy of any size gains over one of at most an encoder count.

    Contact and sticking make errors jump: the few windows in which it gains most may be left.

    Args:
        gain: without these windows [nats a reading], with bounds.
        worst: the same of a joint alone, of its own readings, where all pass and that is more.
        whole: upper bound with them [nats a reading].
        closes: share that the fit closes of the errors of the others that exceed noise.
        usual: whether the errors of the model's parameters that it takes are as small as usual.
    """

    gain: Gain
    worst: Gain
    whole: float = 0.0
    closes: float = 1.0
    usual: bool = True

    def is_nothing(self, settings: Inference) -> bool:
        """Return whether a fit passes the test of equivalence."""
        return self.usual and self.worst.high <= settings.equivalence_tolerance


def measure_left(
    fitter: Fitter,
    bootstrap: Bootstrap,
    given: Fit,
    fit: Fit,
    windows: np.ndarray,
    most: np.ndarray,
) -> Left:
    """Return what a fit leaves.

    Args:
        fitter: that made it.
        bootstrap: says how sure that is.
        given: the model as given.
        fit: what is measured.
        windows: what a free discrepancy gains in each [nats], (W,).
        most: a count of each joint, in noises, (M,).
    """
    replayer, settings = fitter.replayer, fitter.settings
    readings = replayer.compared * len(most)
    lasting = np.argsort(np.argsort(-windows)) >= int(settings.moments * len(windows))
    gain = bootstrap.gain(np.where(lasting, windows, 0.0))
    held = (one.held[lasting] / replayer.noise for one in (given, fit))
    before, after = (np.sqrt(np.square(errors).sum()) for errors in held)
    least = np.sqrt(replayer.used[lasting].sum() * len(most))  # noise alone
    closes = min(float((before - after) / max(before - least, TINY)), 1.0)
    whole = bootstrap.gain(windows).high / readings
    worst = total = Gain(*(value / readings for value in gain))
    if total.high <= settings.equivalence_tolerance:  # every joint is asked if all pass
        ranges = [(0.0, size) for size in np.where(np.eye(len(most)) > 0, most, np.inf)]
        for score in fitter.score_within(fit, ranges, near=True):
            gain = bootstrap.gain(np.where(lasting, fit.score - score, 0.0))
            one = Gain(*(value / replayer.compared for value in gain))
            worst = max(worst, one, key=lambda gain: gain.high)
    usual = all(map(fitter.likelihood.is_usual, fit.trained))
    return Left(total, worst, whole, closes, usual)


def find_open(fitter: Fitter, fit: Fit, most: np.ndarray) -> list[str]:
    """Return the joints at which a fit's free discrepancy is larger than a count, or all.

    Args:
        fitter: that made it.
        fit: what is measured.
        most: a count of each joint, in noises, (M,).
    """
    sizes = np.max([fitter.likelihood.sizes[trained.size] for trained in fit.trained], axis=0)
    joints = [joint.name for joint in fitter.replayer.data.joints]
    return [name for name, own in zip(joints, sizes > most, strict=True) if own] or joints
