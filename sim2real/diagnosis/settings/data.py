"""Settings of `diagnosis/data`: noise, windows, kinds of moments, the bootstrap."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class Encoder:
    """Detection of readings that are rounded to encoder steps."""

    same: float = setting(1e-6, "rad", "readings closer than this are equal", JUDGED)
    steps_min: int = setting(5, "1", "distinct steps needed to infer a resolution", JUDGED)
    one_count: float = setting(
        1.5, "1", "steps up to this multiple of the smallest step are one count", "derived: below 2"
    )
    tested_counts: float = setting(50.0, "1", "longer steps are not tested", JUDGED)
    whole_error: float = setting(
        0.02, "1", "largest distance from a whole number of counts", JUDGED
    )
    whole_share: float = setting(0.95, "1", "fraction of steps that must be whole counts", JUDGED)


@dataclass(frozen=True)
class NoiseFloor:
    """When commands repeat, and which scatter of repeats is noise."""

    history_s: float = setting(
        1.0, "s", "duration before two moments in which their commands must agree", DEVELOPED
    )
    compared_moments: int = setting(20, "1", "samples of the commands in this duration", COST)
    every_s: float = setting(0.1, "s", "interval between the moments examined", COST)
    same_command: float = setting(2e-3, "rad", "largest difference of equal commands", DEVELOPED)
    moved: float = setting(0.02, "rad", "minimum motion of a command that does not rest", DEVELOPED)
    repeats_min: int = setting(20, "1", "minimum number of repetitions", DEVELOPED)
    outlier_scatter: float = setting(
        5.0,
        "1",
        "multiple of the median scatter beyond which moments are not repetitions",
        DEVELOPED,
    )
    outlier_counts: float = setting(
        3.0, "1", "encoder counts beyond which moments are not repetitions", DEVELOPED
    )
    slow_share: float = setting(0.3, "1", "fraction of the rows that count as slow", DEVELOPED)


@dataclass(frozen=True)
class Windows:
    """How logs are cut into windows, and which of their rows are compared."""

    warm_s: float = setting(0.4, "s", "simulated duration before the comparison starts", DEVELOPED)
    longest_s: float = setting(3.0, "s", "longest window of an ordinary log", DEVELOPED)
    shortest_s: float = setting(0.8, "s", "shortest window with servos on", DEVELOPED)
    windows_usual: int = setting(12, "1", "number of windows of a short log", DEVELOPED)
    windows_max: int = setting(40, "1", "number of windows above which they become longer", COST)
    state_s: float = setting(
        0.25,
        "s",
        "length of windows if the state is logged and no servo corrects errors",
        DEVELOPED,
    )
    unsure_s: float = setting(
        0.7,
        "s",
        "length of windows with uncertain starts, whose effect is removed from the errors",
        DEVELOPED,
    )
    slowest_s: float = setting(12.0, "s", "longest window of slow motions", DEVELOPED)
    turn: float = setting(0.1, "1", "smallest reversal of a command, relative to its range", JUDGED)
    kick_before_s: float = setting(0.03, "s", "time left out before a servo is switched on", JUDGED)
    kick_s: float = setting(
        0.3, "s", "time left out afterwards, because no log has the exact moment", DEVELOPED
    )
    blocked_share: float = setting(
        0.5, "1", "fraction of blocked rows above which a window is left out", JUDGED
    )
    off_unrest: float = setting(
        100.0, "1/s", "penalty of rows without torque in the search for calm starts", JUDGED
    )
    unrest_rows: int = setting(5, "1", "rows over which motion is averaged in this search", JUDGED)
    reach: float = setting(0.25, "1", "largest shift of a start, relative to a window", JUDGED)


@dataclass(frozen=True)
class Simulation:
    """How windows and pieces are simulated."""

    error_max: float = setting(
        10.0, "1", "error assigned to a diverged simulation, relative to the motion", JUDGED
    )
    spread_min: float = setting(1e-3, "rad", "minimum motion to which it is relative", JUDGED)
    strengths: tuple[float, ...] = setting(
        (0.5, 0.2, 0.07),
        "1",
        "motor strengths at which heating is simulated, decreasing",
        DEVELOPED,
    )
    heat_s: float = setting(0.05, "s", "time step of the heating before a window", COST)
    heat_passes: int = setting(
        2, "1", "times that the loads of the other motors are simulated again", DEVELOPED
    )
    gives_way: float = setting(0.3, "1", "loss of strength above which this is done", DEVELOPED)


@dataclass(frozen=True)
class Dataset:
    """Blocks, and which joints moved."""

    block_s: float = setting(1.0, "s", "distance at which errors count as independent", DEVELOPED)
    still_counts: float = setting(3.0, "1", "encoder counts below which a joint rests", JUDGED)
    count_min: float = setting(1e-4, "rad", "minimum size of an encoder count", JUDGED)
    seconds_min: float = setting(
        1.0,
        "s",
        "minimum total duration of the recordings",
        "derived: a block of a second for an interval",
    )


@dataclass(frozen=True)
class Regimes:
    """Kinds of moments."""

    rest_speed: float = setting(0.05, "rad/s", "speed below which a joint rests", JUDGED)
    reversal_before_s: float = setting(0.05, "s", "duration of a reversal before the turn", JUDGED)
    reversal_after_s: float = setting(0.3, "s", "duration of a reversal after the turn", JUDGED)
    still_command: float = setting(2e-3, "rad", "motion of a command below which it rests", JUDGED)
    held_s: float = setting(0.5, "s", "duration after which a still command counts as held", JUDGED)
    smoothing_s: float = setting(0.06, "s", "duration over which speeds are averaged", JUDGED)
    goal_error: float = setting(0.01, "rad", "error below which a joint is at its goal", JUDGED)
    load_min: float = setting(1e-6, "N·m", "gravity torque below which robots have no load", JUDGED)
    load_none: float = setting(0.1, "1", "fraction of the largest load that is not a load", JUDGED)
    rare: float = setting(
        0.98,
        "1",
        "quantile that stands for the maximum; half of it separates small from large",
        JUDGED,
    )
    poses_max: int = setting(2000, "1", "poses in which gravity is computed", COST)


@dataclass(frozen=True)
class Bootstrap:
    """The block bootstrap of all intervals."""

    draws: int = setting(400, "1", "resamples", COST)
    bin_s: float = setting(0.25, "s", "bin width of the residual's autocorrelation", COST)
    blocks_min: int = setting(
        32,
        "1",
        "minimum number of blocks of a recording, whatever the correlation time of its residual",
        "derived: what shows in a tenth of them is drawn again in 19 of 20 resamples",
    )
    tail: float = setting(0.05, "1", "probability below and above an interval", "convention: 90 %")


@dataclass(frozen=True)
class Kinds:
    """When commands cannot be meant for the model's actuators."""

    follows: float = setting(
        0.8,
        "1",
        "similarity of position and command (1 − residual / spread) above which commands are "
        "positions",
        JUDGED,
    )
    stranger: float = setting(0.6, "1", "similarity below which commands may be torques", JUDGED)
    rows: int = setting(25, "1", "largest delay of a position, in rows", COST)
    lost: float = setting(
        0.5, "1", "error of a replay that fails, relative to the spread of the joints", JUDGED
    )
    better: float = setting(
        0.3, "1", "largest error with commands as torques, relative to that as positions", JUDGED
    )
    acting: float = setting(
        0.1,
        "1",
        "largest error with commands as torques, relative to that without commands",
        DEVELOPED,
    )
    most: float = setting(10.0, "1", "largest error of a row, relative to the spread", JUDGED)
    seconds: float = setting(0.3, "s", "length of a replayed piece", COST)
    pieces: int = setting(8, "1", "number of replayed pieces", COST)
