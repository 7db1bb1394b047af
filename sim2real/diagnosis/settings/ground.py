"""Settings of `diagnosis/ground`: robots whose base nothing holds."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting

GAIT = "set by hand on walks of an emulated quad8 (benchmarks/ground.py, seed 1); not studied"


@dataclass(frozen=True)
class Ground:
    """The estimate of a base that nobody measured, and windows that start from it."""

    rounds: int = setting(6, "1", "rounds in which standing and slipping soles are sorted", COST)
    gap_m: float = setting(0.004, "m", "gap at which a sole hardly stands any more", GAIT)
    leave_m: float = setting(
        5e-4, "m", "height above its lowest sole from which a base flies", "derived: encoder counts"
    )
    slip_m_s: float = setting(0.2, "m/s", "speed from which a sole that touches slips", GAIT)
    sole_m_s: float = setting(0.06, "m/s", "speed of a sole that stands: it rolls, gives", GAIT)
    sole_m: float = setting(0.002, "m", "height of a sole that stands", GAIT)
    rise_m: float = setting(0.002, "m", "doubt of the height's change between two rows", GAIT)
    stance_m_s2: float = setting(
        8.0, "m/s²", "change of the base's speed while soles touch, without accelerometer", GAIT
    )
    flight_m_s2: float = setting(2.0, "m/s²", "the same in flight, without gravity", JUDGED)
    felt_m_s2: float = setting(3.0, "m/s²", "the same with an accelerometer", JUDGED)
    prior: float = setting(1e-3, "1", "weight of standing still, in squares of 1/speed", JUDGED)
    upright_s: float = setting(1.0, "s", "time over which felt acceleration points up", JUDGED)
    bend_doubt: float = setting(0.1, "1", "doubt of a slope, of its change between rows", JUDGED)
    speed_doubt: float = setting(0.05, "rad/s", "least doubt of a joint's speed", JUDGED)
    spin_doubt: float = setting(0.05, "rad/s", "doubt of the base's angular velocity", JUDGED)
    walk_doubt: tuple[float, float] = setting(
        (0.15, 0.4), "m/s", "least and largest doubt of the base's speed", JUDGED
    )
    window_s: float = setting(0.3, "s", "length of a window", GAIT)
    difference: float = setting(0.5, "1", "deviations over which responses are computed", JUDGED)
    height_doubt: float = setting(0.003, "m", "doubt of the base's height", JUDGED)
    turn_doubt: float = setting(0.005, "rad", "doubt of the base's turn", JUDGED)
    reading_doubt: float = setting(0.002, "rad", "doubt of a joint's position", JUDGED)
    late_doubt: float = setting(
        0.02, "s", "readings may be late by so much: doubt of positions, over usual speeds", JUDGED
    )
    turn_floor: float = setting(0.002, "rad", "noise of the base's turn", JUDGED)
    error_rad: float = setting(0.002, "rad", "errors other than those of a wrong start", JUDGED)
    trusted_rad: float = setting(
        0.004, "rad", "rest up to which starts follow the model that leaves it", GAIT
    )
    step_max: float = setting(3.0, "1", "deviations by which a start is moved at most", JUDGED)
    step_shares: tuple[float, ...] = setting(
        (1.0, 0.5), "1", "shares of the smoother's step that are tried", COST
    )
    grips: tuple[float, float] = setting(
        (0.7, 1.5), "1", "friction of the feet that is tried, of the model's", JUDGED
    )
    grip_floors: float = setting(0.5, "1", "change in floors from which friction is known", JUDGED)
    stands: float = setting(0.5, "1", "touch from which a sole stands", JUDGED)
    seen: float = setting(0.02, "1", "share of the rows in which a sole is a foot", JUDGED)
    slips: float = setting(0.1, "1", "share of its stance from which a slip is reported", JUDGED)
    bias_rad_s: float = setting(0.02, "rad/s", "bias of a gyro that is reported", JUDGED)
    scale_off: float = setting(0.1, "1", "error of a gyro's scale that is reported", JUDGED)
    late_s: float = setting(0.004, "s", "latency of a gyro that is reported", JUDGED)
    smoothing: tuple[float, float, float] = setting(
        (1 / 6, 2 / 3, 1 / 6), "1", "weights of three rows", "derived: Simpson's rule"
    )
    edge: int = setting(2, "1", "rows at an episode's ends that slopes leave out", JUDGED)
    tilt_most: float = setting(0.15, "rad", "largest turn of the ground that is tried", JUDGED)
    tilt_grid: int = setting(13, "1", "turns tried about each axis", COST)
    tilt_rad: float = setting(0.02, "rad", "turn of the ground that is reported", JUDGED)
    tilt_better: float = setting(
        0.7, "1", "distance between the two lowest soles with that turn, of that without", JUDGED
    )
    push_times: float = setting(
        8.0, "1", "error of the base's turn in a pushed window, of the median one", JUDGED
    )
    push_rad: float = setting(0.02, "rad", "least such error", JUDGED)
    odd_times: float = setting(
        3.0, "1", "such error from which a window counts for less, of the median one", JUDGED
    )
    odd_rad: float = setting(0.004, "rad", "least error of a window that counts for less", JUDGED)
    push_share: float = setting(0.1, "1", "share of windows above which none is pushed", JUDGED)
    narrow_m2: float = setting(1e-3, "m²", "least triangle that carries a robot, twice", JUDGED)
    lean_margin: float = setting(
        0.05, "1", "barycentric coordinate by which a centre may be outside", JUDGED
    )
    lean_most: float = setting(0.8, "rad", "largest tilt of a robot that rests", JUDGED)
    rests: float = setting(0.9, "1", "share of the rows in which a robot must rest", JUDGED)
    lean_doubt: float = setting(0.02, "rad", "doubt of the turn of a base that rests", JUDGED)
    lean_spin_doubt: float = setting(
        0.3, "rad/s", "doubt of its angular velocity, and most of it", JUDGED
    )
