"""Settings of `diagnosis/comparison`: when a robot counts as changed."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import JUDGED, setting

WATCHED = (
    *("coulomb_friction", "viscous_friction", "backlash", "joint_compliance"),
    *("position_gain", "motor_strength", "supply_voltage", "dead_zone", "command_delay"),
    *("encoder_offset", "payload", "gravity_tilt"),
)


@dataclass(frozen=True)
class Compared:
    """When `compare` reports a change of the robot, and what it attributes to other differences."""

    watched: tuple[str, ...] = setting(
        WATCHED,
        "effects that are tested: wear, play, supply, zeros, load, mounting",
        JUDGED,
        unit="",
    )
    alpha: float = setting(
        0.02,
        "probability of a false alarm over all effects and locations",
        "judgement: a nightly guard may err once in two months; sessions differ by more than "
        "chance, which must fit into 0.05 too",
    )
    same_rows: float = setting(
        0.9, "fraction of rows with equal commands above which logs show the same motion", JUDGED
    )
    apart: float = setting(
        0.05,
        "smallest fraction of an effect's response that no other effect reproduces",
        "measured: of 15 % more friction at one of two joints that became warmer, 0.07 to 0.7",
    )
    worth: float = setting(
        1.1,
        "smallest RMS response of a reported change, times the root of the number of "
        "pieces, relative to the noise of a reading",
        "derived: noise that lasts a piece makes about 1; measured: of 16 unchanged pairs of an "
        "emulated arm2 the largest that chance did not explain had 0.96",
    )
    doubt: float = setting(
        0.5,
        "smallest response of a reported change, relative to the response to other differences",
        "measured: of 12 pairs with 15 % more friction at one joint the smallest had 1.1",
    )
    warm_friction: float = setting(
        0.01,
        "expected relative decrease of all friction per kelvin, and its standard deviation",
        "judgement: grease thins by about 1 % a kelvin",
        unit="1/K",
    )
    unknown_warmer: float = setting(
        10.0, "temperature difference assumed if temperatures are not logged", JUDGED, unit="K"
    )
    same_voltage: float = setting(
        0.03,
        "smallest relative difference of median voltages that counts as a changed supply",
        JUDGED,
    )

    @property
    def unequal(self) -> float:
        """Relative change per kelvin of one joint's friction, strength or gain that may be warmth.

        Half of what all friction loses: of four pairs of an emulated arm2 that became warmer by 4
        to 8 K, joints that warmed alike differed by 0.3 to 0.4 % a kelvin.
        """
        return self.warm_friction / 2

    @property
    def logs_min(self) -> int:
        """Pairs of logs (or logs per side) from which whole logs are permuted: 2^-n < alpha."""
        return math.ceil(-math.log2(self.alpha))

    @property
    def blocks_min(self) -> int:
        """Independent pieces below which nothing can be decided: 2^-n is a quarter of that."""
        return self.logs_min + 2
