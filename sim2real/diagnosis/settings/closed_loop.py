"""Settings of `diagnosis/closed_loop`: the policy in the corrected simulator."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class ClosedLoopSettings:
    """How much a policy plays, and how what is measured then is compared."""

    episodes: int = setting(32, "1", "episodes in each simulator", COST)
    rows: int = setting(4, "1", "consecutive rows of a history", JUDGED)
    samples: int = setting(40, "1", "histories of an episode that are compared", COST)
    directions: int = setting(64, "1", "along which distributions are compared", COST)
    draws: int = setting(200, "1", "draws of episodes that intervals are taken from", COST)
    negligible: float = setting(
        0.05,
        "1",
        "sliced Wasserstein distance that counts as none, of the channels' deviations",
        "measured: emulated quad8 with nothing hidden, 0.030 and 0.043"
        " (benchmarks/notebook/walking.md)",
    )
    rate_error: float = setting(
        0.1, "1", "largest difference of the log's and the policy's rate", JUDGED
    )
