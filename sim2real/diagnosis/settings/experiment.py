"""Settings of the next recording: motions, refits, and a robot known by its model alone."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import JUDGED, setting


@dataclass(frozen=True)
class Experiment:
    """The next recording."""

    motion_s: float = setting(8.0, "s", "length of a motion", JUDGED)
    size: float = setting(0.6, "1", "fraction of the distance to the limits", JUDGED)
    size_min: float = setting(0.2, "1", "smallest fraction that is drawn", JUDGED)
    apart_min: float = setting(3.0, "1", "noise floors that separate explanations", JUDGED)
    fall_s: float = setting(2.0, "s", "time without torque in which a robot may fall", JUDGED)
    fallen: float = setting(0.5, "rad", "motion above which it has fallen", JUDGED)
    robot: str = setting(
        "bench1",
        "",
        "robot whose servo, bus, rate and supply are assumed if only a model is given",
        "convention: a desk-top servo",
    )
    edge: float = setting(0.05, "1", "part of the range too close to a limit for a start", JUDGED)
    gain_s: float = setting(5.0, "s", "time to change a register", JUDGED)
    hand_s: float = setting(60.0, "s", "time to change something by hand", JUDGED)
    supply: float = setting(0.85, "1", "factor on the supply voltage", JUDGED)
    load: float = setting(0.3, "1", "added mass, relative to the moving mass", JUDGED)
    tilt: float = setting(math.pi / 6, "rad", "tilt of the base", JUDGED)

    @property
    def apart_sure(self) -> float:
        """Noise floors that need no longer motion: twice those that separate."""
        return 2 * self.apart_min
