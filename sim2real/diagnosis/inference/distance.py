"""How far apart two explanations predict, in nats: the one notion of "cannot be told apart".

    separation(likelihood, one, other, sides)           # after both were fitted

If one explanation is true, recordings like these are expected to favour it by half the squared
distance of the predictions under the covariance of what neither knows: the Kullback-Leibler
divergence of two Gaussians of one covariance (Hunter and Reiner 1965 choose experiments by it).
What starts, usual errors and the discrepancy may make does not part them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.inference.fit import Fit
from sim2real.diagnosis.inference.likelihood import Likelihood


def separation(likelihood: Likelihood, one: Fit, other: Fit, sides: Sequence[np.ndarray]) -> float:
    """Return the expected log ratio of two fits' densities on these windows [nats].

    Args:
        likelihood: of the windows.
        one: whose discrepancy counts.
        other: the explanation beside it.
        sides: the windows of each fold.
    """
    apart = (one.own - other.own)[..., None]
    return sum(
        float(likelihood.curvature(trained, apart, own)[0, 0]) / 2
        for trained, own in zip(one.trained, sides, strict=True)
    )
