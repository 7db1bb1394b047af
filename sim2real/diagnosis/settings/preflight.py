"""Settings of `diagnosis/preflight`: when a log contradicts itself or its model."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting

THOUSAND = "derived: rows this far apart point to milliseconds, not seconds"


@dataclass(frozen=True)
class Preflight:
    """When the columns of a log contradict each other or the model."""

    jitter: float = setting(
        0.25,
        "1",
        "relative deviation from the median row interval that 5 % of the intervals may exceed; one "
        "longer than two intervals by more than that is a gap",
        JUDGED,
    )
    row_s: tuple[float, float] = setting(
        (1e-4, 0.5), "s", "range of the median row interval; else `time` is not in s", THOUSAND
    )
    sparse: float = setting(
        100.0, "1", "longest episode, relative to its rows times the median interval", THOUSAND
    )
    rate_error: float = setting(
        0.1, "1", "largest relative difference between stated rate and time stamps", JUDGED
    )
    lost_share: float = setting(
        0.005, "1", "fraction of lost readings above which they are reported", JUDGED
    )
    counts: float = setting(
        3.0, "1", "smallest change of position that is a motion, in encoder counts", JUDGED
    )
    count_min: float = setting(1e-4, "rad", "smallest encoder count that is assumed", JUDGED)
    noise: float = setting(
        1.5, "1", "largest unreported noise, relative to the rounding error of a count", JUDGED
    )
    moved: float = setting(
        0.02, "rad", "range above which a command, or an unlogged joint, is moving", DEVELOPED
    )
    same_command: float = setting(
        2e-3, "rad", "largest difference between commands that count as equal", DEVELOPED
    )
    still: tuple[float, float] = setting(
        (0.05, 0.005), "rad, m", "motion below which a hinge, or slide, is not diagnosed", JUDGED
    )
    reversals_min: int = setting(
        4, "1", "reversals needed to distinguish friction, play and dead zones", JUDGED
    )
    outside: float = setting(
        0.01,
        "1",
        "largest unreported fraction of commands outside ctrlrange; also the tolerance at "
        "its ends, relative to its width",
        JUDGED,
    )
    beyond: float = setting(
        2.0, "1", "multiple of a hinge's largest angle above which positions are not in rad", JUDGED
    )
    saturated_share: float = setting(
        0.3, "1", "largest unreported fraction of rows at the model's force limit", DEVELOPED
    )
    saturated: float = setting(
        0.9, "1", "fraction of the maximum duty or torque above which it is saturated", JUDGED
    )
    rows_min: int = setting(
        20, "1", "smallest number of rows from which anything is estimated", JUDGED
    )
    sigmas: float = setting(
        4.0, "1", "standard errors above which a deviation is significant", JUDGED
    )
    reach_s: float = setting(0.25, "s", "largest delay that is tried", JUDGED)
    ratio: tuple[float, float] = setting(
        (0.85, 1.18), "1", "two gains, or two speeds, agree if their ratio is within", JUDGED
    )
    share: float = setting(
        0.8,
        "1",
        "smallest fraction of the variance that a fitted relation must explain; smallest "
        "correlation of measured and simulated speed from which a lag is inferred",
        JUDGED,
    )
    worse: float = setting(
        1.2,
        "1",
        "factor on a channel's error above which the channel contradicts the causes",
        JUDGED,
    )
    follows: float = setting(
        0.8,
        "1",
        "similarity (1 − standard deviation of position minus command, relative to that of "
        "the position) above which commands are positions",
        JUDGED,
    )
    stranger: float = setting(0.6, "1", "similarity below which commands may be torques", JUDGED)
    clock: float = setting(
        0.05,
        "1",
        "largest relative difference between measured speed and slope of the positions if "
        "the clock is correct",
        "measured: filtered speed registers of real servos differ by up to 0.024",
    )
    offset_s: float = setting(
        2e-3,
        "s",
        "smallest reported delay of a measured speed, or drift of a clock within an episode; a "
        "jump of the lag is reported from `sigmas` times as much between its ranges",
        "measured: below it logs of the emulator's own speed registers scatter",
    )
    computed: float = setting(
        3e-3,
        "1",
        "largest fraction of a torque's standard deviation that a control law leaves "
        "unexplained if the torque was computed, not measured",
        JUDGED,
    )
    law_residual: float = setting(
        0.03, "1", "largest fraction of the duty's variance that is left unexplained", DEVELOPED
    )
    lost: float = setting(
        0.5, "1", "RMS error above which a replay fails, relative to the joints' spread", JUDGED
    )
    better: float = setting(
        0.1,
        "1",
        "commands are torques if their replay error is below this fraction of the errors with "
        "positions and without commands",
        DEVELOPED,
    )
    brief_s: float = setting(
        0.3, "s", "length of the pieces replayed to distinguish position and torque commands", COST
    )
    lag_windows: int = setting(
        3, "1", "smallest number of windows before, and after, a jump of the lag", JUDGED
    )
    lag_episode_s: float = setting(
        60.0, "s", "time from the start of each episode in which the lag is estimated", COST
    )


@dataclass(frozen=True)
class Obstruction:
    """When a joint counts as obstructed: it rests far from its goal, at a high current."""

    rest_s: float = setting(
        0.1,
        "s",
        "time before and after a row for which an obstructed joint is at rest; an obstruction "
        "lasts at least twice as long",
        DEVELOPED,
    )
    still: float = setting(0.003, "rad", "largest range of positions of a joint at rest", DEVELOPED)
    current: float = setting(
        3.0, "1", "smallest current of an obstructed joint, relative to its usual one", DEVELOPED
    )
    error: float = setting(
        1.6, "1", "smallest error of an obstructed joint, relative to its usual error", DEVELOPED
    )
    margin_s: float = setting(
        0.5, "s", "time before and after an obstruction that is excluded as well", DEVELOPED
    )


@dataclass(frozen=True)
class Hunting:
    """When a servo loop hunts: its joint oscillates while its command does not."""

    counts: float = setting(8.0, "1", "smallest swing, in encoder counts", JUDGED)
    swing: float = setting(
        0.005, "rad or m", "smallest swing; the larger of this and `counts` applies", JUDGED
    )
    swings: int = setting(
        8,
        "1",
        "smallest number of consecutive swings. The joint's command may reverse at most a quarter "
        "as often, other joints' commands half as often",
        DEVELOPED,
    )
    even: float = setting(
        0.5, "1", "smallest of these swings in size and time, relative to the largest", DEVELOPED
    )
    faster_s: tuple[float, ...] = setting(
        (0.2, 0.08), "s", "widths of moving averages subtracted for fast oscillations", DEVELOPED
    )
