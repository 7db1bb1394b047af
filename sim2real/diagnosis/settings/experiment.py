"""Settings of the next recording: motions, refits, and a robot known by its model alone."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import JUDGED, setting


@dataclass(frozen=True)
class Experiment:
    """The next recording."""

    motion_s: float = setting(8.0, "s", "length of a motion", JUDGED)
    size: float = setting(0.6, "1", "part of the way to the limits", JUDGED)
    size_min: float = setting(0.2, "1", "least part of the way that is drawn", JUDGED)
    size_max: float = setting(0.95, "1", "largest part of the way that is drawn", JUDGED)
    count: float = setting(
        2 * math.pi / 4096,
        "rad",
        "encoder count where no floor is known",
        "derived: 12 bits a turn",
    )
    apart_min: float = setting(
        3.0, "1", "noise floors, after refits, that separate explanations", JUDGED
    )
    apart_sure: float = setting(
        6.0, "1", "noise floors from which a longer motion tells nothing more", JUDGED
    )
    past_s: float = setting(5.0, "s", "length of a recorded piece that refits must follow", JUDGED)
    past_most: int = setting(4, "1", "number of such pieces", JUDGED)
    fall_s: float = setting(2.0, "s", "time without torque in which a robot may fall", JUDGED)
    fallen: float = setting(0.5, "rad", "motion from which it has fallen over", JUDGED)
    robot: str = setting(
        "bench1",
        "",
        "whose servo, bus, rate and supply a robot has of which only the model is known",
        "convention: a desk-top servo",
    )
    edge: float = setting(0.05, "1", "part of the range too close to a limit to start from", JUDGED)
    gain: float = setting(0.5, "1", "factor of the P gain", JUDGED)
    gain_s: float = setting(5.0, "s", "time to change a register", JUDGED)
    hand_s: float = setting(60.0, "s", "time to change something by hand", JUDGED)
    supply: float = setting(0.85, "1", "factor of the supply's voltage", JUDGED)
    load: float = setting(0.3, "1", "added mass, of what moves", JUDGED)
    load_radius: float = setting(0.005, "m", "radius of the ball that stands for it", JUDGED)
    tilt: float = setting(math.pi / 6, "rad", "tilt of the base", JUDGED)
