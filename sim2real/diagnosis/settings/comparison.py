"""Settings of `diagnosis/comparison`: when a robot counts as changed."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class Compared:
    """What is watched for a change, and what is put down to something else."""

    watched: tuple[str, ...] = setting(
        (
            "coulomb_friction",
            "viscous_friction",
            "backlash",
            "joint_compliance",
            "position_gain",
            "motor_strength",
            "supply_voltage",
            "dead_zone",
            "command_delay",
            "encoder_offset",
            "payload",
            "gravity_tilt",
        ),
        "1",
        "effects that may change: wear, play, supply, zeros, load, mounting",
        JUDGED,
    )
    alpha: float = setting(
        0.02,
        "1",
        "probability of any false alarm by chance, over all effects at all locations",
        "judgement: a nightly guard may err once in two months; sessions differ by more than "
        "chance, which must fit into 0.05 too",
    )
    draws: int = setting(2000, "1", "permutations of before and after", COST)
    same_rows: float = setting(
        0.9,
        "1",
        "fraction of rows with equal commands from which two logs contain the same motion",
        JUDGED,
    )
    weight_floor: float = setting(
        0.5, "1", "minimum noise of a piece in its weight, relative to the median piece", JUDGED
    )
    apart: float = setting(
        0.05,
        "1",
        "minimum fraction of an effect's response that no other compared effect shares",
        "measured: of 15 % more friction at one of two joints that became warmer, 0.07 to 0.7",
    )
    step: float = setting(
        0.2,
        "1",
        "change of factors and tilts in finite differences, relative to their smallest probe",
        "derived: the smallest probe of a factor is a quarter, changes are some per cent",
    )
    alike: float = setting(
        6.0,
        "1",
        "difference of −2 log likelihood up to which effects explain equally well",
        "derived: odds of 20",
    )
    changes_max: int = setting(4, "1", "maximum number of named changes", JUDGED)
    worth: float = setting(
        1.1,
        "1",
        "minimum response of a named change, relative to a reading's noise over the root of the "
        "number of pieces (both RMS)",
        "derived: noise that lasts a piece makes about 1; measured: of 16 unchanged pairs of an "
        "emulated arm2 the largest that chance did not explain had 0.96",
    )
    doubt: float = setting(
        0.5,
        "1",
        "minimum response of a change, relative to that attributed linearly to other differences",
        "measured: of 12 pairs with 15 % more friction at one joint the smallest had 1.1",
    )
    excused_rounds: int = setting(
        2, "1", "number of simulations of the changes attributed to other differences", COST
    )
    shared_max: int = setting(2, "1", "effects fitted to both sides, in addition to friction", COST)
    shared_worth: float = setting(
        0.1, "1", "minimum fraction of the gap that a further shared effect closes", JUDGED
    )
    little: float = setting(
        2.0,
        "1",
        "standard deviations attributed to temperature at equal temperatures",
        "derived: odds of 20",
    )
    same_temperature: float = setting(
        1.0,
        "K",
        "difference of the median temperatures up to which temperature explains nothing",
        "derived: copper resists 0.4 % more a kelvin, and half a per cent is seen",
    )
    clock: float = setting(
        5e-4,
        "s",
        "standard deviation of a joint's reading time between sessions",
        "derived: a servo's ticks are about a millisecond apart",
    )
    warm_friction: float = setting(
        0.01,
        "1/K",
        "change of all friction with temperature (standard deviation)",
        "judgement: grease thins by about 1 % a kelvin",
    )
    warm_strength: float = setting(
        0.004,
        "1/K",
        "change of all motors' strength with temperature (standard deviation)",
        "derived: copper resists 0.4 % more a kelvin",
    )
    unequal: float = setting(
        0.005,
        "1/K",
        "further change of one joint's friction, strength or gain with temperature; at equal "
        "temperatures, that of one kelvin",
        "measured: four pairs of an emulated arm2 that became warmer by 4 to 8 K differed by 0.3 "
        "to 0.4 % a kelvin between joints that warmed alike",
    )
    unknown_warmer: float = setting(
        10.0, "K", "assumed temperature difference if temperatures are not logged", JUDGED
    )
    same_voltage: float = setting(
        0.03,
        "1",
        "relative difference of the median voltages above which the supply has changed",
        JUDGED,
    )
    thermal: tuple[str, ...] = setting(
        ("coulomb_friction", "viscous_friction", "motor_strength"),
        "1",
        "effects that temperature changes in all joints alike",
        "derived: grease thins, copper resists, magnets weaken",
    )

    @property
    def logs_min(self) -> int:
        """Pairs of logs (or logs per side) from which whole logs are permuted: 2^-n < alpha."""
        return math.ceil(-math.log2(self.alpha))

    @property
    def blocks_min(self) -> int:
        """Independent pieces below which nothing can be decided: 2^-n is a quarter of that."""
        return self.logs_min + 2
