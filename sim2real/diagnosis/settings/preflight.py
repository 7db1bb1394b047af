"""Settings of `diagnosis/preflight`: when a log contradicts itself or its model."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting

THOUSAND = "derived: rows this far apart point to milliseconds, not seconds"


@dataclass(frozen=True)
class Channels:
    """What a log's channels must agree on."""

    jitter: float = setting(0.25, "1", "largest deviation of an interval from the median", JUDGED)
    jitter_percentile: float = setting(
        95.0, "%", "percentile of the intervals that is checked", JUDGED
    )
    gap: float = setting(2.5, "1", "multiple of the median interval that is a gap", JUDGED)
    lost_share: float = setting(0.005, "1", "smallest reported fraction of lost readings", JUDGED)
    repeat_counts: float = setting(
        3.0, "1", "encoder counts by which a joint moves around a repeated reading", JUDGED
    )
    count_min: float = setting(1e-6, "rad", "minimum size of an encoder count", JUDGED)
    slowest_s: float = setting(
        0.5, "s", "longest interval in seconds; longer ones are in another unit", THOUSAND
    )
    fastest_s: float = setting(
        1e-4, "s", "shortest interval in seconds; shorter ones are in another unit", THOUSAND
    )
    sparse: float = setting(
        100.0,
        "times",
        "largest duration of an episode, relative to its rows times the median interval",
        THOUSAND,
    )
    rate_error: float = setting(
        0.1, "1", "largest relative difference between `rate` and the time stamps", JUDGED
    )
    still_rad: float = setting(0.05, "rad", "motion below which a hinge is not checked", JUDGED)
    still_m: float = setting(0.005, "m", "motion below which a slide is not checked", JUDGED)
    reversals_min: int = setting(4, "1", "reversals needed to identify friction and play", JUDGED)
    reversal_size: float = setting(0.1, "1", "smallest reversal, relative to the motion", JUDGED)
    outside_share: float = setting(
        0.01, "1", "smallest reported fraction of commands outside ctrlrange", JUDGED
    )
    outside_slack: float = setting(
        0.01, "1", "tolerance around ctrlrange, relative to its width", JUDGED
    )
    beyond: float = setting(
        2.0, "1", "multiple of a hinge's range beyond which positions are not in rad", JUDGED
    )
    worse: float = setting(
        1.2,
        "1",
        "error of a channel with the causes that contradicts them, relative to the error "
        "without them",
        JUDGED,
    )
    worse_noises: float = setting(
        3.0, "1", "minimum increase of this error, relative to the noise of the channel", JUDGED
    )
    saturated_share: float = setting(
        0.3,
        "1",
        "fraction of rows at the force limit above which gains cannot be identified",
        DEVELOPED,
    )


@dataclass(frozen=True)
class Speeds:
    """What speed registers must agree with."""

    ratio: tuple[float, float] = setting(
        (0.85, 1.18), "1", "ratios of speed register and slope that agree", JUDGED
    )
    clock: float = setting(
        0.05,
        "1",
        "largest relative difference of a measured speed and the slope if the clock is correct",
        "measured: filtered speed registers of real servos differ by up to 0.024",
    )
    share: float = setting(
        0.8, "1", "fraction of the position's variance that a speed must explain", JUDGED
    )
    offset_s: float = setting(
        2e-3,
        "s",
        "delay of a speed against its position worth a finding",
        "measured: below it logs of the emulator's own speed registers scatter",
    )
    sigmas: float = setting(4.0, "1", "standard errors that a delay must exceed", JUDGED)
    reach_s: float = setting(0.25, "s", "largest delay tried", JUDGED)
    rows_min: int = setting(20, "1", "rows that an episode needs for a fit of the speed", JUDGED)


@dataclass(frozen=True)
class Servo:
    """What duty and torque registers must agree with."""

    computed: float = setting(
        3e-3,
        "1",
        "residual of a control law below which a logged torque was computed, relative to its "
        "spread",
        JUDGED,
    )
    law_residual: float = setting(
        0.03, "1", "fraction of the duty's variance that a control law may leave", DEVELOPED
    )
    delays_s: tuple[float, float] = setting(
        (0.1, 0.004), "s", "largest delay of a command tried, and the step", JUDGED
    )
    full_pwm: float = setting(
        885.0, "1", "duty register at full duty", "reference: Dynamixel X e-manual, PWM Limit"
    )
    turn_counts: float = setting(
        4096 / (2 * math.pi),
        "1/rad",
        "encoder counts per radian",
        "reference: Dynamixel X e-manual, 4096 a turn",
    )
    ratio: tuple[float, float] = setting(
        (0.9, 1.1),
        "1",
        "ratios of real to model gain, and of position to command gain, that agree",
        JUDGED,
    )
    duty_share_max: float = setting(
        1.5, "1", "duties above this are in register units", "derived: a share of full is at most 1"
    )
    saturated: float = setting(
        0.9, "1", "saturation threshold, relative to full duty or the largest torque", JUDGED
    )
    rows_min: int = setting(50, "1", "rows needed for a fit of the duty or the torque", JUDGED)


@dataclass(frozen=True)
class Clocks:
    """When clocks contradict each other."""

    sigmas: float = setting(4.0, "1", "standard errors that an offset must exceed", JUDGED)
    drift_ppm: float = setting(
        50.0,
        "ppm",
        "smallest reported drift",
        "reference: a crystal's tolerance is 20 to 50 ppm",
    )
    log_s: float = setting(
        20.0,
        "s",
        "minimum length of a log that is checked for drift",
        "derived: 200 ppm are then 4 ms",
    )


@dataclass(frozen=True)
class Lag:
    """When the robot's lag jumps within a log."""

    window_s: float = setting(3.0, "s", "length of a window", JUDGED)
    reach_s: float = setting(0.25, "s", "largest lag tried", JUDGED)
    alike: float = setting(0.7, "1", "correlation needed to estimate a lag", JUDGED)
    speed_min: float = setting(0.1, "rad/s", "RMS speed below which a joint rests", JUDGED)
    windows_min: int = setting(3, "1", "windows needed on either side of a jump", JUDGED)
    jump_s: float = setting(
        0.008, "s", "minimum distance between the lags on both sides", DEVELOPED
    )
    episode_s: float = setting(60.0, "s", "part of each episode that is examined", COST)


@dataclass(frozen=True)
class Obstruction:
    """When something holds a joint."""

    rest_s: float = setting(
        0.1, "s", "duration before and after a row in which a joint rests", DEVELOPED
    )
    still: float = setting(0.003, "rad", "largest motion of a joint that rests", DEVELOPED)
    usual: float = setting(0.9, "1", "quantile that counts as usual in a joint at rest", DEVELOPED)
    current: float = setting(
        3.0, "1", "obstructed above this multiple of the usual current", DEVELOPED
    )
    error: float = setting(1.6, "1", "obstructed above this multiple of the usual error", DEVELOPED)
    margin_s: float = setting(0.5, "s", "time left out before and after", DEVELOPED)
    rests_min: int = setting(50, "1", "rows at rest needed to define usual values", JUDGED)
    shortest_s: float = setting(
        0.2, "s", "minimum total duration; a shorter one is a spike", JUDGED
    )


@dataclass(frozen=True)
class Hunting:
    """When a servo's loop hunts."""

    counts: float = setting(8.0, "1", "minimum encoder counts of a swing", JUDGED)
    swing: float = setting(0.005, "rad or m", "minimum size of a swing", JUDGED)
    swings: int = setting(
        8, "1", "minimum number of consecutive swings that are hunting", DEVELOPED
    )
    even: float = setting(0.5, "1", "minimum ratio of the smallest to the largest swing", DEVELOPED)
    regular: float = setting(
        0.5, "1", "minimum ratio of the shortest to the longest half period", DEVELOPED
    )
    asked: float = setting(0.1, "1", "smallest reversal of a command, relative to a swing", JUDGED)
    asked_turns: int = setting(
        2, "1", "maximum number of reversals of the command during these swings", DEVELOPED
    )
    shaken_turns: int = setting(
        4, "1", "the same for the other joints' commands: a gait shakes joints at rest", JUDGED
    )
    faster_s: tuple[float, ...] = setting(
        (0.2, 0.08),
        "s",
        "lengths of moving averages that are subtracted to find faster oscillations",
        DEVELOPED,
    )
    riding: float = setting(
        0.1,
        "1",
        "minimum size of such an oscillation, relative to the motion; less may be stick-slip",
        DEVELOPED,
    )
    kept: float = setting(1.0, "1", "number of first swings that are compared", DEVELOPED)
    calm_s: float = setting(0.3, "s", "time without hunting after which a new hunt begins", JUDGED)
    settle_s: float = setting(0.2, "s", "time left out after the last swing", JUDGED)


@dataclass(frozen=True)
class Checks:
    """Detection of readings that scatter by more than a count."""

    noise: float = setting(1.5, "1", "reported above this multiple of the resolution", JUDGED)
    rounding_min: float = setting(1e-5, "rad", "minimum size of the resolution", JUDGED)


@dataclass(frozen=True)
class Unlogged:
    """When a joint that a log does not hold counts as moving."""

    seconds: float = setting(3.0, "s", "length of the replays that show a motion", COST)
    pieces: int = setting(2, "1", "replays of each log", COST)
    moves: float = setting(
        0.02, "rad", "minimum motion; for an orientation, of the elements of its quaternion", JUDGED
    )
