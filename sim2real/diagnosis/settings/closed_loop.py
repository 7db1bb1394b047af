"""Settings of `diagnosis/closed_loop`: the policy in the corrected simulator."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class ClosedLoopSettings:
    """The comparison of robot and simulators while the policy acts."""

    episodes: int = setting(32, "number of episodes in each simulator", COST)
    rows: int = setting(4, "number of consecutive rows in a sample", JUDGED)
    samples: int = setting(40, "largest number of samples from an episode", COST)
    negligible: float = setting(
        0.05,
        "negligible sliced Wasserstein distance, in standard deviations of the channels",
        "measured: emulated quad8 with nothing hidden, 0.030 and 0.043"
        " (benchmarks/notebook/walking.md)",
    )
