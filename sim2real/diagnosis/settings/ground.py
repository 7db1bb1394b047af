"""Settings of `diagnosis/ground`: robots whose base nothing holds."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting

GAIT = "set by hand on walks of an emulated quad8 (benchmarks/ground.py, seed 1); not studied"


@dataclass(frozen=True)
class Ground:
    """The estimate of a base that nobody measured, and windows that start from it."""

    rounds: int = setting(6, "1", "rounds that classify standing and slipping feet", COST)
    gap_m: float = setting(0.004, "m", "gap at which a foot hardly carries any load", GAIT)
    leave_m: float = setting(
        5e-4,
        "m",
        "height above ground contact from which the base is in flight",
        "derived: encoder counts",
    )
    slip_m_s: float = setting(0.2, "m/s", "speed above which a foot in contact slips", GAIT)
    sole_m_s: float = setting(0.06, "m/s", "speed of a standing foot, which rolls and yields", GAIT)
    sole_m: float = setting(
        0.002, "m", "height of a standing foot, and of a step of the height between rows", GAIT
    )
    stance_m_s2: float = setting(
        8.0,
        "m/s²",
        "acceleration of the base while feet are in contact, without an accelerometer",
        GAIT,
    )
    flight_m_s2: float = setting(2.0, "m/s²", "the same in flight, without gravity", JUDGED)
    felt_m_s2: float = setting(3.0, "m/s²", "the same with an accelerometer", JUDGED)
    prior: float = setting(1e-3, "1", "weight of zero speed, in 1/speed²", JUDGED)
    upright_s: float = setting(
        1.0, "s", "time over which the measured acceleration points up on average", JUDGED
    )
    bend_doubt: float = setting(
        0.1, "1", "standard deviation of a slope, relative to its change between rows", JUDGED
    )
    speed_doubt: float = setting(
        0.05,
        "rad/s",
        "minimum standard deviation of a joint's speed and of the base's rotation rate",
        JUDGED,
    )
    walk_doubt: tuple[float, float] = setting(
        (0.15, 0.4), "m/s", "minimum and maximum standard deviation of the base's speed", JUDGED
    )
    window_s: float = setting(0.3, "s", "length of a window", GAIT)
    height_doubt: float = setting(0.003, "m", "standard deviation of the base's height", JUDGED)
    turn_doubt: float = setting(0.005, "rad", "standard deviation of the base's rotation", JUDGED)
    late_doubt: float = setting(
        0.02,
        "s",
        "delay of readings; times the usual speed, it adds to the standard deviation of positions",
        JUDGED,
    )
    error_rad: float = setting(
        0.002,
        "rad",
        "noise of a joint's position and of the base's orientation",
        JUDGED,
    )
    told_rad: float = setting(
        0.02,
        "rad",
        "orientation error of a push, tilt of the ground, bias of a gyro [rad/s] worth a finding",
        JUDGED,
    )
    told_share: float = setting(
        0.1,
        "1",
        "reported part of a stance with slip, and scale error of a gyro; of windows, above which "
        "none is a push",
        JUDGED,
    )
    step_max: float = setting(3.0, "1", "largest correction of a start, in deviations", JUDGED)
    grips: tuple[float, float] = setting(
        (0.7, 1.5),
        "1",
        "tried friction coefficients of the feet, relative to the model's",
        JUDGED,
    )
    grip_floors: float = setting(
        0.5, "1", "change, in noise floors, above which friction is identified", JUDGED
    )
    stands: float = setting(0.5, "1", "contact weight above which a foot stands", JUDGED)
    seen: float = setting(0.02, "1", "fraction of rows in contact that makes a foot", JUDGED)
    late_s: float = setting(0.004, "s", "latency of a gyro that is reported", JUDGED)
    tilt_most: float = setting(0.15, "rad", "largest tilt of the ground that is tried", JUDGED)
    tilt_better: float = setting(
        0.7,
        "1",
        "distance between the two lowest feet with this tilt, relative to that without",
        JUDGED,
    )
    push_times: float = setting(
        8.0, "1", "minimum orientation error of a pushed window, relative to the median", JUDGED
    )
    narrow_m2: float = setting(
        1e-3, "m²", "twice the area of the smallest triangle that supports a robot", JUDGED
    )
    lean_margin: float = setting(
        0.05, "1", "barycentric coordinate by which the centre of mass may be outside", JUDGED
    )
    lean_most: float = setting(0.8, "rad", "largest tilt of a robot at rest", JUDGED)
    rests: float = setting(0.9, "1", "fraction of the rows in which a robot must rest", JUDGED)
    lean_doubt: float = setting(
        0.02, "rad", "standard deviation of a resting base's rotation", JUDGED
    )
    lean_spin_doubt: float = setting(
        0.3, "rad/s", "standard deviation and upper limit of its angular velocity", JUDGED
    )
