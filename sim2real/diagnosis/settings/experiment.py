"""Settings of the next recording: motions, refits, and a robot known by its model alone."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import JUDGED, setting


@dataclass(frozen=True)
class Experiment:
    """The motions from which the next recording is chosen."""

    motion_s: float = setting(8.0, "duration of a motion", JUDGED)
    size: float = setting(
        0.6, "amplitude of a motion, relative to the distance to the nearer limit", JUDGED
    )
    apart_min: float = setting(
        3.0, "smallest distance between separated explanations, in noise floors", JUDGED
    )
    fallen: float = setting(
        0.5, "motion of a joint without torque above which the robot falls", JUDGED, unit="rad"
    )
    edge: float = setting(
        0.05, "part of a joint's range, at each limit, in which no motion starts", JUDGED
    )
    hand_s: float = setting(60.0, "time assumed for a change by hand", JUDGED)
    supply: float = setting(
        0.85, "supply voltage in a proposed motion, relative to the full voltage", JUDGED
    )
    load: float = setting(
        0.3, "mass of an additional load in a proposed motion, relative to the moving mass", JUDGED
    )

    @property
    def size_min(self) -> float:
        """Smallest amplitude of a randomly drawn motion: a third of the usual one."""
        return self.size / 3

    @property
    def apart_sure(self) -> float:
        """Noise floors that need no longer motion: twice those that separate."""
        return 2 * self.apart_min
