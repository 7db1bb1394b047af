"""Settings of `diagnosis/preflight`: when a log contradicts itself or its model."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import DEVELOPED, JUDGED, setting

THOUSAND = "derived: rows this far apart point to milliseconds, not seconds"


@dataclass(frozen=True)
class Preflight:
    """When the columns of a log contradict each other or the model."""

    jitter: float = setting(
        0.25,
        "relative deviation from the median row interval that 5 % of the intervals may exceed; one "
        "longer than two intervals by more than that is a gap",
        JUDGED,
    )
    row_s: tuple[float, float] = setting(
        (1e-4, 0.5), "range of the median row interval; else `time` is not in s", THOUSAND
    )
    sparse: float = setting(
        100.0, "longest episode, relative to its rows times the median interval", THOUSAND
    )
    rate_error: float = setting(
        0.1, "largest relative difference between stated rate and time stamps", JUDGED
    )
    unreported: float = setting(
        0.005,
        "largest unreported fraction of lost readings, and of commands outside ctrlrange; also the "
        "tolerance at its ends, relative to its width",
        JUDGED,
    )
    counts: float = setting(
        3.0, "smallest change of position that is a motion, in encoder counts", JUDGED
    )
    count_min: float = setting(1e-4, "smallest encoder count that is assumed", JUDGED, unit="rad")
    moved: float = setting(
        0.02, "range above which a command, or an unlogged joint, is moving", DEVELOPED, unit="rad"
    )
    same_command: float = setting(
        2e-3,
        "largest difference between commands that count as equal, or between positions of a joint "
        "at rest",
        DEVELOPED,
        unit="rad",
    )
    still: tuple[float, float] = setting(
        (0.05, 0.005),
        "motion below which a hinge, or slide, is not diagnosed",
        JUDGED,
        unit="rad, m",
    )
    reversals_min: int = setting(
        4, "reversals needed to distinguish friction, play and dead zones", JUDGED
    )
    rows_min: int = setting(20, "smallest number of rows from which anything is estimated", JUDGED)
    sigmas: float = setting(4.0, "standard errors above which a deviation is significant", JUDGED)
    reach_s: float = setting(0.25, "largest delay that is tried", JUDGED)
    ratio: tuple[float, float] = setting(
        (0.85, 1.18), "two gains, speeds or errors agree if their ratio is within", JUDGED
    )
    share: float = setting(
        0.8,
        "smallest fraction of the variance that a fitted relation, or a replay, must explain; "
        "smallest correlation of measured and simulated speed from which a lag is inferred",
        JUDGED,
    )
    follows: float = setting(
        0.8,
        "similarity (1 − standard deviation of position minus command, relative to that of "
        "the position) above which commands are positions; below it they may be torques",
        JUDGED,
    )
    clock: float = setting(
        0.05,
        "largest relative difference between measured speed and slope of the positions if "
        "the clock is correct",
        "measured: filtered speed registers of real servos differ by up to 0.024",
    )
    offset_s: float = setting(
        2e-3,
        "smallest reported delay of a measured speed, or drift of a clock within an episode; a "
        "jump of the lag is reported from `sigmas` times as much between its ranges",
        "measured: below it logs of the emulator's own speed registers scatter",
    )
    computed: float = setting(
        3e-3,
        "largest fraction of a torque's standard deviation that a control law leaves "
        "unexplained if the torque was computed, not measured",
        JUDGED,
    )
    law_residual: float = setting(
        0.03, "largest fraction of the duty's variance that is left unexplained", DEVELOPED
    )
    better: float = setting(
        0.1,
        "commands are torques if their replay error is below this fraction of the errors with "
        "positions and without commands",
        DEVELOPED,
    )


@dataclass(frozen=True)
class Obstruction:
    """When a joint counts as obstructed: it rests far from its goal, at a high current."""

    rest_s: float = setting(
        0.1,
        "time before and after a row for which an obstructed joint is at rest; an obstruction "
        "lasts at least twice as long",
        DEVELOPED,
    )
    current: float = setting(
        3.0, "smallest current of an obstructed joint, relative to its usual one", DEVELOPED
    )


@dataclass(frozen=True)
class Hunting:
    """When a servo loop hunts: its joint oscillates while its command does not."""

    swing: float = setting(
        0.005, "smallest swing; at least a motion in encoder counts", JUDGED, unit="rad or m"
    )
    swings: int = setting(
        8,
        "smallest number of consecutive swings. The joint's command may reverse at most a quarter "
        "as often, other joints' commands half as often",
        DEVELOPED,
    )
    even: float = setting(
        0.5, "smallest of these swings in size and time, relative to the largest", DEVELOPED
    )
