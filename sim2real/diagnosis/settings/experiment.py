"""Settings of the next recording: motions, refits, and a robot known by its model alone."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import JUDGED, setting


@dataclass(frozen=True)
class Experiment:
    """The motions from which the next recording is chosen."""

    motion_s: float = setting(8.0, "s", "duration of a motion", JUDGED)
    size: float = setting(
        0.6, "1", "amplitude of a motion, relative to the distance to the nearer limit", JUDGED
    )
    size_min: float = setting(
        0.2, "1", "smallest amplitude of a randomly drawn motion, relative to that distance", JUDGED
    )
    apart_min: float = setting(
        3.0, "1", "distance from which two explanations are separated, in noise floors", JUDGED
    )
    fall_s: float = setting(
        2.0, "s", "time without torque that is simulated to see whether the robot falls", JUDGED
    )
    fallen: float = setting(
        0.5, "rad", "motion of a joint in this time above which the robot falls", JUDGED
    )
    robot: str = setting(
        "bench1",
        "",
        "robot whose servo, bus, rate and supply are assumed if only a model is given",
        "convention: a desk-top servo",
    )
    edge: float = setting(
        0.05, "1", "part of a joint's range, at each limit, in which no motion starts", JUDGED
    )
    gain_s: float = setting(5.0, "s", "time assumed for changing a register", JUDGED)
    hand_s: float = setting(60.0, "s", "time assumed for a change by hand", JUDGED)
    supply: float = setting(
        0.85, "1", "supply voltage in a proposed motion, relative to the full voltage", JUDGED
    )
    load: float = setting(
        0.3,
        "1",
        "mass of an additional load in a proposed motion, relative to the moving mass",
        JUDGED,
    )
    tilt: float = setting(math.pi / 6, "rad", "tilt of the base in a proposed motion", JUDGED)

    @property
    def apart_sure(self) -> float:
        """Noise floors that need no longer motion: twice those that separate."""
        return 2 * self.apart_min
