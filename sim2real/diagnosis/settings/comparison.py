"""Settings of `diagnosis/comparison`: when a robot counts as changed."""

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
        "probability of any false alarm by chance, over all effects at all places",
        "judgement: a nightly guard may err once in two months; sessions differ by more than "
        "chance, which must fit into 0.05 too",
    )
    draws: int = setting(2000, "1", "permutations of before and after", COST)
    blocks_min: int = setting(
        8,
        "1",
        "independent pieces below which nothing can be concluded",
        "derived: 2^-8 is well below the probability of a false alarm",
    )
    logs_min: int = setting(
        6,
        "1",
        "pairs of logs (or logs a side) from which whole logs are permuted",
        "derived: 2^-6 is below the probability of a false alarm",
    )
    same_command: float = setting(1e-3, "rad", "commands closer than this are the same", JUDGED)
    same_rows: float = setting(
        0.9,
        "1",
        "share of rows with the same command from which two logs are of one motion",
        JUDGED,
    )
    weight_floor: float = setting(
        0.5, "1", "least noise of a piece, of the median piece's, that its weight counts", JUDGED
    )
    apart: float = setting(
        0.05,
        "1",
        "share of its response that an effect has to itself, among those it is compared with",
        "measured: of 15 % more friction at one of two joints that became warmer, 0.07 to 0.7",
    )
    step: float = setting(
        0.2,
        "1",
        "share of the smallest probe that a factor and a tilt are moved by",
        "derived: the smallest probe of a factor is a quarter, changes are some per cent",
    )
    alike: float = setting(
        6.0,
        "1",
        "fall of -2 log likelihood up to which effects explain alike",
        "derived: odds of 20",
    )
    changes_max: int = setting(4, "1", "changes that are named at most", JUDGED)
    worth: float = setting(
        1.1,
        "1",
        "least response of a change that is named, of a reading's noise (both RMS) over the root "
        "of the number of pieces",
        "derived: noise that lasts a piece makes about 1; measured: of 16 unchanged pairs of an "
        "emulated arm2 the largest that chance did not explain had 0.96",
    )
    doubt: float = setting(
        0.5,
        "1",
        "least response of a change, of what straight lines put down to other things and changes",
        "measured: of 12 pairs with 15 % more friction at one joint the smallest had 1.1",
    )
    excused_rounds: int = setting(
        2, "1", "times that what is put down to other things is simulated", COST
    )
    shared_max: int = setting(2, "1", "effects fitted to both sides, in addition to friction", COST)
    shared_worth: float = setting(
        0.1, "1", "share of the gap that a further shared effect closes at least", JUDGED
    )
    shared_windows: int = setting(
        12,
        "1",
        "windows that they are fitted to",
        "measured: the four worst of an arm are free swings, in which friction has other optima",
    )
    shared_rounds: int = setting(6, "1", "steps of its fit", COST)
    little: float = setting(
        2.0,
        "1",
        "standard deviations that temperature may do at the same temperature",
        "derived: odds of 20",
    )
    same_temperature: float = setting(
        1.0,
        "K",
        "difference of the medians up to which temperature explains nothing",
        "derived: copper resists 0.4 % more a kelvin, and half a per cent is seen",
    )
    clock: float = setting(
        5e-4,
        "s",
        "what a joint's readings come earlier or later in another session (standard deviation)",
        "derived: a servo's ticks are about a millisecond apart",
    )
    warm_friction: float = setting(
        0.01,
        "1/K",
        "share of all friction that temperature changes (standard deviation)",
        "judgement: grease thins by about 1 % a kelvin",
    )
    warm_strength: float = setting(
        0.004,
        "1/K",
        "share of a motor's strength, likewise",
        "derived: copper resists 0.4 % more a kelvin",
    )
    unequal_friction: float = setting(
        0.005,
        "1/K",
        "share of a joint's friction, dry and viscous, that temperature may change beyond what it "
        "does to all; at the same temperature, of a kelvin",
        "judgement: half of what it does to all joints (grease thins by about 1 % a kelvin)",
    )
    unequal_strength: float = setting(
        0.005,
        "1/K",
        "share of a motor's strength or gain, likewise",
        "measured: four pairs of an emulated arm2 that became warmer by 4 to 8 K differed by 0.3 "
        "to 0.4 % a kelvin between joints that warmed alike",
    )
    unknown_warmer: float = setting(
        10.0, "K", "difference of temperatures that are not logged", JUDGED
    )
    same_voltage: float = setting(
        0.03, "1", "relative difference of the medians from which the supply is another", JUDGED
    )
    thermal: tuple[str, ...] = setting(
        ("coulomb_friction", "viscous_friction", "motor_strength"),
        "1",
        "what temperature changes in all joints alike",
        "derived: grease thins, copper resists, magnets weaken",
    )
