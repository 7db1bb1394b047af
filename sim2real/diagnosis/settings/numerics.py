"""Settings of `diagnosis/numerics`: what is the simulator's own doing."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class Numerics:
    """When a gap or a cause is the simulator's own doing."""

    piece_s: float = setting(5.0, "s", "length of a replayed piece", COST)
    pieces: int = setting(4, "1", "number of replayed pieces", COST)
    change: float = setting(0.1, "1", "relative change of the gap that counts", DEVELOPED)
    change_min: float = setting(
        0.005, "1", "minimum such change, relative to the motion", DEVELOPED
    )
    gain_left: float = setting(0.25, "1", "minimum remaining gain of a physical effect", DEVELOPED)
    armature: float = setting(
        5e-4,
        "kg·m²",
        "armature of joints that have none",
        "reference: below that of the smallest servo (XL-320, 1.1e-3)",
    )
    motion_min: float = setting(0.03, "rad", "minimum motion that errors are relative to", JUDGED)
    error_max: float = setting(5.0, "1", "largest error, relative to the motion", JUDGED)
    tolerance: float = setting(1e-12, "1", "tolerance of the tighter solver", JUDGED)
    line_tolerance: float = setting(1e-6, "1", "tolerance of its line search", JUDGED)
    iterations: int = setting(4, "1", "its iterations, relative to the model's", JUDGED)
