"""Settings of `diagnosis/closed_loop`: the policy in the corrected simulator."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class ClosedLoopSettings:
    """How much a policy plays, and how what is measured then is compared."""

    episodes: int = setting(32, "1", "episodes in each simulator", COST)
    rows: int = setting(4, "1", "consecutive rows in a history", JUDGED)
    samples: int = setting(40, "1", "compared histories per episode", COST)
    directions: int = setting(64, "1", "directions along which distributions are compared", COST)
    draws: int = setting(200, "1", "resamples of episodes for intervals", COST)
    negligible: float = setting(
        0.05,
        "1",
        "negligible sliced Wasserstein distance, in deviations of the channels",
        "measured: emulated quad8 with nothing hidden, 0.030 and 0.043"
        " (benchmarks/notebook/walking.md)",
    )
    rate_error: float = setting(
        0.1, "1", "largest relative difference between the rates of log and policy", JUDGED
    )
