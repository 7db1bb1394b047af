"""Settings of `diagnosis/ground`: robots whose base nothing holds."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting

GAIT = "set by hand on walks of an emulated quad8 (benchmarks/ground.py, seed 1); not studied"


@dataclass(frozen=True)
class Ground:
    """The motion of an unlogged base, estimated from feet on the ground and an IMU."""

    rounds: int = setting(
        6, "number of iterations that classify feet as standing or slipping", COST
    )
    gap_m: float = setting(
        0.004, "gap under a foot at which its contact weight has fallen to 37 %", GAIT
    )
    slip_m_s: float = setting(
        0.2,
        "speed above which a foot slips, where its weight as a standing foot is half its contact "
        "weight; smallest standard deviation of the base's estimated speed",
        GAIT,
    )
    sole_m_s: float = setting(
        0.06, "standard deviation of a standing foot's speed (it rolls and yields)", GAIT
    )
    sole_m: float = setting(
        0.002,
        "standard deviation of a standing foot's height, of the base's height and of its change "
        "between rows",
        GAIT,
    )
    stance_m_s2: float = setting(
        8.0, "standard deviation of the base's acceleration while feet touch the ground", GAIT
    )
    felt_m_s2: float = setting(
        2.0,
        "standard deviation of the base's acceleration from its accelerometer's reading, or from "
        "free fall in flight",
        JUDGED,
    )
    upright_s: float = setting(
        1.0, "averaging time of the accelerometer, whose mean points up", JUDGED
    )
    speed_doubt: float = setting(
        0.05,
        "standard deviation of the base's angular velocity from an IMU; where a speed is a slope "
        "of positions, its RMS change between rows is added",
        JUDGED,
        unit="rad/s",
    )
    window_s: float = setting(0.3, "length of a window that starts from an estimated base", GAIT)
    error_rad: float = setting(
        0.002,
        "standard deviation of a measured position and of the base's orientation from an IMU",
        JUDGED,
    )
    told_rad: float = setting(
        0.02,
        "smallest reported tilt of the ground, error of a gyro [rad/s] and orientation error of a "
        "pushed window; standard deviation of an orientation without an IMU",
        JUDGED,
    )
    told_share: float = setting(
        0.1,
        "smallest reported error of a gyro, relative to its motion, fraction of slipping contact, "
        "and gain of the feet's evenness by a tilt of the ground; largest fraction of windows that "
        "may count as pushed, and of rows in which a resting robot may lean out",
        JUDGED,
    )
    grips: tuple[float, float] = setting(
        (0.7, 1.5),
        "friction coefficients of the feet that are tried, relative to the model",
        JUDGED,
    )
    tilt_most: float = setting(0.15, "largest tilt of the ground that is tried", JUDGED, unit="rad")
    lean_rad_s: float = setting(
        0.3, "standard deviation and largest RMS of a resting base's angular velocity", JUDGED
    )
    push_times: float = setting(
        8.0, "smallest orientation error of a pushed window, relative to the median", JUDGED
    )
