"""Settings of `diagnosis/numerics`: what is the simulator's own doing."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import DEVELOPED, setting


@dataclass(frozen=True)
class Numerics:
    """When a gap or a cause is the simulator's own doing."""

    change: float = setting(0.1, "1", "relative change of the gap that counts", DEVELOPED)
    change_min: float = setting(0.005, "1", "minimum such change, over the motion", DEVELOPED)
    gain_left: float = setting(0.25, "1", "minimum remaining gain of a physical effect", DEVELOPED)
