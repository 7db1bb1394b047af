"""Settings of `diagnosis/preflight`: when a log contradicts itself or its model."""

import math
from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting

THOUSAND = "derived: rows this far apart point to milliseconds, not seconds"


@dataclass(frozen=True)
class Channels:
    """What a log's channels must agree on."""

    jitter: float = setting(0.25, "1", "deviation of an interval, of the median one", JUDGED)
    jitter_percentile: float = setting(95.0, "%", "intervals that must deviate less", JUDGED)
    gap: float = setting(2.5, "1", "an interval this multiple of the median is a gap", JUDGED)
    lost_share: float = setting(0.005, "1", "share of lost readings worth a finding", JUDGED)
    repeat_counts: float = setting(
        3.0, "1", "encoder counts that a joint moves around a repeated reading", JUDGED
    )
    count_min: float = setting(1e-6, "rad", "an encoder count is taken as at least this", JUDGED)
    slowest_s: float = setting(0.5, "s", "longer intervals are refused", THOUSAND)
    fastest_s: float = setting(1e-4, "s", "shorter intervals are refused", THOUSAND)
    sparse: float = setting(100.0, "times", "an episode's time over that of its rows", THOUSAND)
    rate_error: float = setting(0.1, "1", "disagreement of `rate` and the stamps", JUDGED)
    still_rad: float = setting(0.05, "rad", "a hinge that moves less is not judged", JUDGED)
    still_m: float = setting(0.005, "m", "a slide that moves less is not judged", JUDGED)
    reversals_min: int = setting(4, "1", "reversals that friction and play need", JUDGED)
    reversal_size: float = setting(0.1, "1", "least size of a reversal, of the motion", JUDGED)
    outside_share: float = setting(0.01, "1", "share of commands outside ctrlrange", JUDGED)
    outside_slack: float = setting(0.01, "1", "slack around ctrlrange, of its width", JUDGED)
    beyond: float = setting(2.0, "1", "times a hinge's range that no rad reach", JUDGED)
    worse: float = setting(
        1.2, "1", "channel off with the causes, of that without, that contradicts them", JUDGED
    )
    worse_noises: float = setting(3.0, "1", "the same, in noises of the channel", JUDGED)
    saturated_share: float = setting(
        0.3, "1", "share of rows at the force limit above which gains do not show", DEVELOPED
    )


@dataclass(frozen=True)
class Speeds:
    """What speed registers must agree with."""

    ratio: tuple[float, float] = setting(
        (0.85, 1.18), "1", "ratios of speed register and slope that agree", JUDGED
    )
    share: float = setting(
        0.8, "1", "share of the position's variance that a speed must explain", JUDGED
    )
    offset_s: float = setting(
        2e-3,
        "s",
        "delay of a speed against its position worth a finding",
        "measured: below it logs of the emulator's own speed registers scatter",
    )
    sigmas: float = setting(4.0, "1", "standard errors that a delay must exceed", JUDGED)
    reach_s: float = setting(0.25, "s", "largest delay looked for", JUDGED)
    rows_min: int = setting(20, "1", "rows of an episode below which no speed law", JUDGED)


@dataclass(frozen=True)
class Servo:
    """What duty and torque registers must agree with."""

    computed: float = setting(
        3e-3, "1", "what a law leaves of a torque that was computed, of its spread", JUDGED
    )
    law_residual: float = setting(
        0.03, "1", "share of the duty's variance that a law may leave", DEVELOPED
    )
    delays_s: tuple[float, float] = setting(
        (0.1, 0.004), "s", "largest delay of a command tried, and the step", JUDGED
    )
    full_pwm: float = setting(
        885.0, "1", "duty register at full", "reference: Dynamixel X e-manual, PWM Limit"
    )
    turn_counts: float = setting(
        4096 / (2 * math.pi),
        "1/rad",
        "encoder counts",
        "reference: Dynamixel X e-manual, 4096 a turn",
    )
    ratio: tuple[float, float] = setting(
        (0.9, 1.1), "1", "ratios of real and model gain, of both columns' gains, that agree", JUDGED
    )
    duty_share_max: float = setting(
        1.5, "1", "larger duties are in register units", "derived: a share of full is at most 1"
    )
    saturated: float = setting(
        0.9, "1", "duties, and torques over the largest, from here on are saturated", JUDGED
    )
    rows_min: int = setting(50, "1", "rows below which no duty or torque law", JUDGED)


@dataclass(frozen=True)
class Clocks:
    """When clocks contradict each other."""

    sigmas: float = setting(4.0, "1", "standard errors that a drift must exceed", JUDGED)
    drift_ppm: float = setting(
        50.0, "ppm", "least drift named", "reference: a crystal's tolerance is 20 to 50 ppm"
    )
    log_s: float = setting(
        20.0, "s", "length of a log whose drift is examined", "derived: 200 ppm are then 4 ms"
    )


@dataclass(frozen=True)
class Lag:
    """When the robot's lag jumps within a log."""

    window_s: float = setting(3.0, "s", "length of a window", JUDGED)
    reach_s: float = setting(0.25, "s", "largest lag looked for", JUDGED)
    alike: float = setting(0.7, "1", "correlation below which a lag means nothing", JUDGED)
    speed_min: float = setting(0.1, "rad/s", "RMS speed below which nothing moves", JUDGED)
    windows_min: int = setting(3, "1", "windows on either side of a jump", JUDGED)
    jump_s: float = setting(0.008, "s", "distance of the closest lags of both sides", DEVELOPED)
    episode_s: float = setting(60.0, "s", "part of each episode that is examined", COST)


@dataclass(frozen=True)
class Obstruction:
    """When something holds a joint."""

    rest_s: float = setting(0.1, "s", "time on either side that a joint rests", DEVELOPED)
    still: float = setting(0.003, "rad", "a resting joint moves less in it", DEVELOPED)
    usual: float = setting(0.9, "1", "quantile of a joint's rests that is usual", DEVELOPED)
    current: float = setting(3.0, "1", "multiple of the usual current", DEVELOPED)
    error: float = setting(1.6, "1", "multiple of the usual error", DEVELOPED)
    margin_s: float = setting(0.5, "s", "time left out before and after", DEVELOPED)
    rests_min: int = setting(50, "1", "rows at rest below which nothing is usual", JUDGED)
    shortest_s: float = setting(0.2, "s", "less in a whole log is a spike", JUDGED)


@dataclass(frozen=True)
class Hunting:
    """When a servo's loop hunts."""

    counts: float = setting(8.0, "1", "encoder counts that a swing has at least", JUDGED)
    swing: float = setting(0.005, "rad or m", "a swing has at least", JUDGED)
    swings: int = setting(8, "1", "swings in a row that make it hunting", DEVELOPED)
    even: float = setting(0.5, "1", "least of these, of the largest: ringing dies away", DEVELOPED)
    regular: float = setting(0.5, "1", "least time between turns, of the longest", DEVELOPED)
    asked: float = setting(0.1, "1", "turns of a command this size count, of a swing", JUDGED)
    asked_turns: int = setting(2, "1", "turns of the command among these swings at most", DEVELOPED)
    shaken_turns: int = setting(
        4, "1", "the same of other joints' commands: a gait shakes joints that hold still", JUDGED
    )
    faster_s: tuple[float, ...] = setting(
        (0.2, 0.08), "s", "also looked for in what is left of means over so long", DEVELOPED
    )
    riding: float = setting(
        0.1, "1", "least of those, of the joint's motion: smaller ones may be stick-slip", DEVELOPED
    )
    kept: float = setting(1.0, "1", "first swings that are compared", DEVELOPED)
    calm_s: float = setting(0.3, "s", "time without hunting after which it begins anew", JUDGED)
    settle_s: float = setting(0.2, "s", "time left out after the last swing", JUDGED)


@dataclass(frozen=True)
class Checks:
    """Detection of readings that scatter by more than a count."""

    noise: float = setting(1.5, "1", "multiple of the rounding", JUDGED)
    rounding_min: float = setting(1e-5, "rad", "a rounding is taken as at least this", JUDGED)


@dataclass(frozen=True)
class Unlogged:
    """When a joint that a log does not hold counts as moving."""

    seconds: float = setting(3.0, "s", "length of the replays that show a motion", COST)
    pieces: int = setting(2, "1", "replays of each log", COST)
    moves: float = setting(
        0.02, "rad", "least motion; of an orientation, of its quaternion's numbers", JUDGED
    )
