"""Settings of `diagnosis/data`: noise, windows, kinds of moments, the bootstrap."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class Encoder:
    """Detection of readings that are rounded to encoder steps."""

    same: float = setting(1e-6, "rad", "readings closer than this are equal", JUDGED)
    steps_min: int = setting(5, "1", "distinct steps needed to infer a rounding", JUDGED)
    one_count: float = setting(
        1.5, "1", "steps up to this multiple of the smallest are one count", "derived: below 2"
    )
    tested_counts: float = setting(50.0, "1", "longer steps are not tested", JUDGED)
    whole_error: float = setting(0.02, "1", "distance from a whole number of counts", JUDGED)
    whole_share: float = setting(0.95, "1", "share of steps that must be whole counts", JUDGED)


@dataclass(frozen=True)
class NoiseFloor:
    """When commands repeat, and which scatter of repeats is noise."""

    history_s: float = setting(1.0, "s", "commands that must agree before a moment", DEVELOPED)
    compared_moments: int = setting(20, "1", "moments of the history compared", COST)
    every_s: float = setting(0.1, "s", "interval between moments looked at", COST)
    same_command: float = setting(2e-3, "rad", "commands this close are equal", DEVELOPED)
    moved: float = setting(0.02, "rad", "a command that moves less holds still", DEVELOPED)
    repeats_min: int = setting(20, "1", "repeats below which scatter is not trusted", DEVELOPED)
    outlier_scatter: float = setting(
        5.0, "1", "multiple of the median scatter beyond which moments are no repeats", DEVELOPED
    )
    outlier_counts: float = setting(
        3.0, "1", "encoder counts beyond which moments are no repeats", DEVELOPED
    )
    slow_share: float = setting(0.3, "1", "share of the rows that count as slow", DEVELOPED)


@dataclass(frozen=True)
class Windows:
    """How logs are cut into windows, and which of their rows are compared."""

    warm_s: float = setting(0.4, "s", "simulated before the comparison starts", DEVELOPED)
    longest_s: float = setting(3.0, "s", "longest window of an ordinary log", DEVELOPED)
    shortest_s: float = setting(0.8, "s", "shortest window where servos are on", DEVELOPED)
    windows_usual: int = setting(12, "1", "windows that a short log is cut into", DEVELOPED)
    windows_max: int = setting(40, "1", "windows of a log before they get longer", COST)
    state_s: float = setting(
        0.25, "s", "windows where the state is logged and no servo corrects errors", DEVELOPED
    )
    unsure_s: float = setting(
        0.7, "s", "windows whose starts are uncertain, which is taken out of errors", DEVELOPED
    )
    slowest_s: float = setting(12.0, "s", "longest window of slow motions", DEVELOPED)
    turn: float = setting(0.1, "1", "least turn of a command, of its range", JUDGED)
    begins_s: float = setting(0.05, "s", "rows that tell the speed at a log's first row", JUDGED)
    begins_moving: float = setting(
        0.25, "1", "speed at the first row, of the usual one, that is no start from rest", JUDGED
    )
    begins_least: float = setting(1e-4, "rad", "motion in these rows that counts", JUDGED)
    kick_before_s: float = setting(0.03, "s", "left out before a servo is switched on", JUDGED)
    kick_s: float = setting(
        0.3, "s", "left out after it, since no log has the exact moment", DEVELOPED
    )
    blocked_share: float = setting(0.5, "1", "windows blocked for longer are left out", JUDGED)
    off_unrest: float = setting(100.0, "1/s", "unrest of rows without torque", JUDGED)
    unrest_rows: int = setting(5, "1", "rows that unrest is averaged over", JUDGED)
    reach: float = setting(0.25, "1", "shift of a start to a calm row, of a window", JUDGED)


@dataclass(frozen=True)
class Simulation:
    """How windows and pieces are simulated."""

    error_max: float = setting(10.0, "1", "error of what diverged, of the motion", JUDGED)
    spread_min: float = setting(1e-3, "rad", "least motion that this is taken of", JUDGED)
    strengths: tuple[float, ...] = setting(
        (0.5, 0.2, 0.07), "1", "strengths of motors whose heat is compared, falling", DEVELOPED
    )
    heat_s: float = setting(0.05, "s", "step in which motors heat up to a window's start", COST)
    heat_passes: int = setting(2, "1", "times that other motors' loads are looked at", DEVELOPED)
    gives_way: float = setting(
        0.3, "1", "loss of strength from which other motors' loads are looked at again", DEVELOPED
    )


@dataclass(frozen=True)
class Dataset:
    """Blocks, and which joints moved."""

    block_s: float = setting(1.0, "s", "errors further apart count as independent", DEVELOPED)
    still_counts: float = setting(
        3.0, "1", "encoder counts below which a joint did not move", JUDGED
    )
    count_min: float = setting(1e-4, "rad", "an encoder count is taken as at least this", JUDGED)
    seconds_min: float = setting(
        1.0, "s", "recordings needed in all", "derived: a block of a second for an interval"
    )


@dataclass(frozen=True)
class Regimes:
    """Kinds of moments."""

    rest_speed: float = setting(0.05, "rad/s", "slower joints are at rest", JUDGED)
    reversal_before_s: float = setting(0.05, "s", "part of a reversal before the turn", JUDGED)
    reversal_after_s: float = setting(0.3, "s", "part of a reversal after the turn", JUDGED)
    still_command: float = setting(2e-3, "rad", "a held command moves less", JUDGED)
    held_s: float = setting(0.5, "s", "time from which a still command is held", JUDGED)
    smoothing_s: float = setting(0.06, "s", "window that speeds are averaged over", JUDGED)
    goal_error: float = setting(0.01, "rad", "a joint this close is at its goal", JUDGED)
    load_min: float = setting(1e-6, "N·m", "robots with less gravity load have no loads", JUDGED)
    load_none: float = setting(0.1, "1", "share of the largest load that is no load", JUDGED)
    rare: float = setting(0.98, "1", "quantile rarely exceeded; half of it splits the rest", JUDGED)
    poses_max: int = setting(2000, "1", "poses in which gravity is computed", COST)


@dataclass(frozen=True)
class Bootstrap:
    """The block bootstrap of all intervals."""

    draws: int = setting(400, "1", "resamples", COST)
    bin_s: float = setting(0.25, "s", "bins in which the residue's autocorrelation is taken", COST)
    blocks_min: int = setting(
        32,
        "1",
        "blocks that a recording is cut into at least, however long its residue hangs together",
        "derived: what shows in a tenth of them is drawn again in 19 of 20 resamples",
    )
    tail: float = setting(0.05, "1", "probability below and above an interval", "convention: 90 %")


@dataclass(frozen=True)
class Kinds:
    """When commands cannot be meant for the model's actuators."""

    follows: float = setting(
        0.8,
        "1",
        "likeness from which positions are their commands, 1 less the rest's share",
        JUDGED,
    )
    stranger: float = setting(0.6, "1", "likeness below which they may be torques", JUDGED)
    rows: int = setting(25, "1", "rows by which a position may be late", COST)
    lost: float = setting(0.5, "1", "gap of a replay that fails, over the joints' spread", JUDGED)
    better: float = setting(0.3, "1", "gap as torques, of that as positions", JUDGED)
    acting: float = setting(0.1, "1", "gap as torques, of that without commands", DEVELOPED)
    most: float = setting(10.0, "1", "a row counts at most so much, in spreads", JUDGED)
    seconds: float = setting(0.3, "s", "length of a replayed piece", COST)
    pieces: int = setting(8, "1", "pieces replayed", COST)
