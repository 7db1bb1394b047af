"""Settings of `diagnosis/preflight`: when a log contradicts itself or its model."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting

THOUSAND = "derived: rows this far apart point to milliseconds, not seconds"


@dataclass(frozen=True)
class Preflight:
    """What a log's columns must agree on; what counts as a motion, a delay or a law of them."""

    jitter: float = setting(
        0.25, "1", "deviation of an interval from the median one, in one of 20 intervals", JUDGED
    )
    gap: float = setting(2.5, "1", "multiple of the median interval that is a gap", JUDGED)
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
        0.1, "1", "largest relative difference between a stated rate and the time stamps", JUDGED
    )
    drift_ppm: float = setting(
        50.0,
        "ppm",
        "smallest drift of a clock that is reported",
        "reference: a crystal's tolerance is 20 to 50 ppm",
    )
    drift_s: float = setting(
        20.0, "s", "minimum length of a log checked for drift", "derived: 200 ppm are then 4 ms"
    )
    lost_share: float = setting(0.005, "1", "fraction of lost readings that is reported", JUDGED)
    counts: float = setting(3.0, "1", "encoder counts that show a motion", JUDGED)
    count_min: float = setting(1e-4, "rad", "minimum size of an encoder count", JUDGED)
    noise: float = setting(1.5, "1", "multiple of a count's rounding that is noise", JUDGED)
    moved: float = setting(
        0.02, "rad", "motion of a command, or of an unlogged joint, that is no rest", DEVELOPED
    )
    same_command: float = setting(2e-3, "rad", "largest difference of equal commands", DEVELOPED)
    still_rad: float = setting(0.05, "rad", "motion below which a hinge is not checked", JUDGED)
    still_m: float = setting(0.005, "m", "motion below which a slide is not checked", JUDGED)
    reversals_min: int = setting(4, "1", "reversals needed to identify friction and play", JUDGED)
    outside: float = setting(
        0.01, "1", "fraction of commands outside ctrlrange, by this part of its width", JUDGED
    )
    beyond: float = setting(
        2.0, "1", "multiple of a hinge's range beyond which positions are not in rad", JUDGED
    )
    saturated_share: float = setting(
        0.3,
        "1",
        "fraction of rows at the force limit above which gains cannot be identified",
        DEVELOPED,
    )
    saturated: float = setting(
        0.9, "1", "duties, and torques over the largest, from here on are saturated", JUDGED
    )
    worse: float = setting(
        1.2,
        "1",
        "error of a channel with the causes that contradicts them, relative to the error "
        "without them",
        JUDGED,
    )
    rows_min: int = setting(20, "1", "rows below which nothing is estimated", JUDGED)
    sigmas: float = setting(4.0, "1", "noises, or standard errors, that are no chance", JUDGED)
    reach_s: float = setting(0.25, "s", "largest delay looked for", JUDGED)
    ratio: tuple[float, float] = setting(
        (0.85, 1.18), "1", "ratios of two gains, or of speed and slope, that agree", JUDGED
    )
    share: float = setting(0.8, "1", "fraction of the variance that a law must explain", JUDGED)
    clock: float = setting(
        0.05,
        "1",
        "largest relative difference of a measured speed and the slope if the clock is correct",
        "measured: filtered speed registers of real servos differ by up to 0.024",
    )
    offset_s: float = setting(
        2e-3,
        "s",
        "delay of a speed against its position worth a finding",
        "measured: below it logs of the emulator's own speed registers scatter",
    )
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
    follows: float = setting(
        0.8,
        "1",
        "similarity of position and command (1 − residual / spread) above which commands are "
        "positions",
        JUDGED,
    )
    stranger: float = setting(0.6, "1", "similarity below which commands may be torques", JUDGED)
    lost: float = setting(
        0.5, "1", "error of a replay that fails, relative to the spread of the joints", JUDGED
    )
    better: float = setting(
        0.1,
        "1",
        "largest error with commands as torques, relative to that as positions or without any",
        DEVELOPED,
    )
    brief_s: float = setting(0.3, "s", "length of a piece replayed with other commands", COST)
    lag_alike: float = setting(0.7, "1", "correlation needed to estimate a lag", JUDGED)
    lag_windows: int = setting(3, "1", "windows needed on either side of a jump of it", JUDGED)
    lag_jump_s: float = setting(
        0.008, "s", "minimum distance between the lags on both sides", DEVELOPED
    )
    lag_episode_s: float = setting(60.0, "s", "part of each episode examined for a lag", COST)


@dataclass(frozen=True)
class Obstruction:
    """When something holds a joint."""

    rest_s: float = setting(
        0.1,
        "s",
        "duration on either side in which a joint rests; a shorter one is a spike",
        DEVELOPED,
    )
    still: float = setting(0.003, "rad", "largest motion of a joint that rests", DEVELOPED)
    current: float = setting(3.0, "1", "multiple of the usual current", DEVELOPED)
    error: float = setting(1.6, "1", "multiple of the usual error", DEVELOPED)
    margin_s: float = setting(0.5, "s", "time left out before and after", DEVELOPED)


@dataclass(frozen=True)
class Hunting:
    """When a servo's loop hunts."""

    counts: float = setting(8.0, "1", "minimum encoder counts of a swing", JUDGED)
    swing: float = setting(0.005, "rad or m", "minimum size of a swing", JUDGED)
    swings: int = setting(
        8,
        "1",
        "least number of swings during which the command turns at most a quarter, and other "
        "joints' commands (a gait) half as often",
        DEVELOPED,
    )
    even: float = setting(
        0.5,
        "1",
        "minimum ratio of the smallest to the largest swing, in size and in time",
        DEVELOPED,
    )
    asked: float = setting(
        0.1,
        "1",
        "smallest reversal of a command, relative to a swing, and smallest faster oscillation, "
        "relative to the motion; smaller ones may be stick-slip",
        DEVELOPED,
    )
    faster_s: tuple[float, ...] = setting(
        (0.2, 0.08),
        "s",
        "lengths of moving averages that are subtracted to find faster oscillations",
        DEVELOPED,
    )
    calm_s: float = setting(
        0.3, "s", "time left out after the last swing, and then until a new hunt begins", JUDGED
    )
