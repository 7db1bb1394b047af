"""Settings of `diagnosis/numerics`: what is the simulator's own doing."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class Numerics:
    """When a gap or a cause is the simulator's own doing."""

    piece_s: float = setting(5.0, "s", "length of a replayed piece", COST)
    pieces: int = setting(4, "1", "pieces replayed", COST)
    change: float = setting(0.1, "1", "change, of the gap, that is one", DEVELOPED)
    change_min: float = setting(0.005, "1", "change, of the motion, that matters", DEVELOPED)
    gain_left: float = setting(
        0.25, "1", "share of an effect's gain that must stay for it to be physics", DEVELOPED
    )
    armature: float = setting(
        5e-4,
        "kg·m²",
        "armature of joints without any",
        "reference: below that of the smallest servo (XL-320, 1.1e-3)",
    )
    motion_min: float = setting(0.03, "rad", "a joint that moves less counts as this", JUDGED)
    error_max: float = setting(5.0, "1", "larger errors count as this, of the motion", JUDGED)
    tolerance: float = setting(1e-12, "1", "the tighter solver's tolerance", JUDGED)
    line_tolerance: float = setting(1e-6, "1", "the same of its line search", JUDGED)
    iterations: int = setting(4, "1", "the tighter solver's iterations, of the model's", JUDGED)
