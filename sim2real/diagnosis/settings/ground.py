"""Settings of `diagnosis/ground`: robots whose base nothing holds."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting

GAIT = "set by hand on walks of an emulated quad8 (benchmarks/ground.py, seed 1); not studied"


@dataclass(frozen=True)
class Ground:
    """The motion of an unlogged base, estimated from feet on the ground and an IMU."""

    rounds: int = setting(
        6, "1", "number of iterations that classify feet as standing or slipping", COST
    )
    gap_m: float = setting(
        0.004, "m", "gap under a foot at which its contact weight has fallen to 37 %", GAIT
    )
    leave_m: float = setting(
        5e-4,
        "m",
        "height above the ground contact at which the base is in flight",
        "derived: encoder counts",
    )
    slip_m_s: float = setting(
        0.2,
        "m/s",
        "speed above which a foot slips; at this speed, its weight as a standing foot is "
        "half its contact weight",
        GAIT,
    )
    sole_m_s: float = setting(
        0.06, "m/s", "standard deviation of a standing foot's speed (it rolls and yields)", GAIT
    )
    sole_m: float = setting(
        0.002,
        "m",
        "standard deviation of a standing foot's height, and of the base's change of height "
        "between rows",
        GAIT,
    )
    stance_m_s2: float = setting(
        8.0,
        "m/s²",
        "standard deviation of the base's acceleration while feet touch the ground",
        GAIT,
    )
    flight_m_s2: float = setting(
        2.0,
        "m/s²",
        "standard deviation of the base's acceleration from free fall, in flight",
        JUDGED,
    )
    felt_m_s2: float = setting(
        3.0,
        "m/s²",
        "standard deviation of the base's acceleration from its accelerometer's reading",
        JUDGED,
    )
    upright_s: float = setting(
        1.0, "s", "averaging time of the accelerometer, whose mean points up", JUDGED
    )
    bend_doubt: float = setting(
        0.1,
        "1",
        "standard deviation of a joint's speed, relative to its change between rows",
        JUDGED,
    )
    speed_doubt: float = setting(
        0.05,
        "rad/s",
        "smallest standard deviation of a joint's speed, and standard deviation of the base's "
        "angular velocity from an IMU",
        JUDGED,
    )
    walk_doubt: tuple[float, float] = setting(
        (0.15, 0.4),
        "m/s",
        "smallest and largest standard deviation of the base's estimated speed",
        JUDGED,
    )
    window_s: float = setting(
        0.3, "s", "length of a window that starts from an estimated base", GAIT
    )
    height_doubt: float = setting(
        0.003, "m", "standard deviation of the base's estimated height", JUDGED
    )
    turn_doubt: float = setting(
        0.005, "rad", "standard deviation of the base's orientation from an IMU", JUDGED
    )
    late_doubt: float = setting(
        0.02,
        "s",
        "assumed delay of readings; multiplied by a joint's RMS speed, it adds to the "
        "standard deviation of its position",
        JUDGED,
    )
    error_rad: float = setting(
        0.002,
        "rad",
        "standard deviation of a measured position and of the IMU's orientation",
        JUDGED,
    )
    told_rad: float = setting(
        0.02,
        "rad",
        "smallest reported tilt of the ground, gyro bias [rad/s] and orientation error of a "
        "pushed window",
        JUDGED,
    )
    told_share: float = setting(
        0.1,
        "1",
        "smallest reported scale error of a gyro and fraction of slipping contact; largest "
        "fraction of windows that may count as pushed",
        JUDGED,
    )
    step_max: float = setting(
        3.0, "1", "largest correction of an initial state, in standard deviations", JUDGED
    )
    grips: tuple[float, float] = setting(
        (0.7, 1.5),
        "1",
        "friction coefficients of the feet that are tried, relative to the model",
        JUDGED,
    )
    grip_floors: float = setting(
        0.5, "1", "smallest change of the motion that identifies friction, in noise floors", JUDGED
    )
    stands: float = setting(
        0.5, "1", "contact weight above which a foot touches the ground, or stands on it", JUDGED
    )
    late_s: float = setting(
        0.004,
        "s",
        "smallest latency of a gyro relative to the orientation that is reported",
        JUDGED,
    )
    tilt_most: float = setting(0.15, "rad", "largest tilt of the ground that is tried", JUDGED)
    tilt_better: float = setting(
        0.7,
        "1",
        "a tilt is reported if it reduces the height difference of the two lowest feet "
        "below this fraction",
        JUDGED,
    )
    push_times: float = setting(
        8.0, "1", "smallest orientation error of a pushed window, relative to the median", JUDGED
    )
    lean_margin: float = setting(
        0.05,
        "1",
        "largest distance of the centre of mass from a triangle of standing feet, as a barycentric "
        "coordinate",
        JUDGED,
    )
    lean_most: float = setting(0.8, "rad", "largest tilt of a robot that rests on its feet", JUDGED)
    lean_spin_doubt: float = setting(
        0.3,
        "rad/s",
        "standard deviation and largest RMS of a resting base's angular velocity",
        JUDGED,
    )
