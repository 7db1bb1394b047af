"""Settings of `diagnosis/data`: noise, windows, kinds of moments, the bootstrap."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class NoiseFloor:
    """Which readings are rounded, when commands repeat, and which scatter of repeats is noise."""

    steps_min: int = setting(5, "1", "distinct steps needed to infer a resolution", JUDGED)
    whole_error: float = setting(
        0.02, "1", "largest distance from a whole number of counts", JUDGED
    )
    every_s: float = setting(0.1, "s", "interval between the moments examined", COST)
    slow_share: float = setting(0.3, "1", "fraction of the rows that count as slow", DEVELOPED)


@dataclass(frozen=True)
class Windows:
    """How logs are cut into windows, and which of their rows are compared."""

    warm_s: float = setting(0.4, "s", "simulated duration before the comparison starts", DEVELOPED)
    longest_s: float = setting(3.0, "s", "longest window of an ordinary log", DEVELOPED)
    shortest_s: float = setting(0.8, "s", "shortest window with servos on", DEVELOPED)
    windows_usual: int = setting(12, "1", "number of windows of a short log", DEVELOPED)
    windows_max: int = setting(40, "1", "number of windows above which they are longer", COST)
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
    turn: float = setting(0.1, "1", "smallest reversal, relative to the motion", JUDGED)
    kick_before_s: float = setting(0.03, "s", "time left out before a servo is switched on", JUDGED)
    kick_s: float = setting(
        0.3, "s", "time left out afterwards, because no log has the exact moment", DEVELOPED
    )
    unrest_rows: int = setting(5, "1", "rows over which motion is averaged in this search", JUDGED)
    reach: float = setting(0.25, "1", "largest shift of a start, relative to a window", JUDGED)


@dataclass(frozen=True)
class Simulation:
    """How windows and pieces are simulated."""

    error_max: float = setting(
        10.0, "1", "error assigned to a diverged simulation, relative to the motion", JUDGED
    )
    piece_s: float = setting(5.0, "s", "length of a piece of a log that is replayed", COST)
    pieces: int = setting(4, "1", "number of replayed pieces", COST)
    strengths: tuple[float, ...] = setting(
        (0.5, 0.2, 0.07),
        "1",
        "motor strengths at which heating is simulated, decreasing",
        DEVELOPED,
    )
    heat_s: float = setting(0.05, "s", "time step of the heating before a window", COST)
    heat_passes: int = setting(
        2, "1", "number of repeated simulations of the other motors' loads", DEVELOPED
    )
    gives_way: float = setting(0.3, "1", "loss of strength above which this is done", DEVELOPED)


@dataclass(frozen=True)
class Regimes:
    """Kinds of moments."""

    rest_speed: float = setting(0.05, "rad/s", "speed below which a joint rests", JUDGED)
    reversal_after_s: float = setting(0.3, "s", "duration of a reversal after the turn", JUDGED)
    held_s: float = setting(0.5, "s", "duration after which a still command counts as held", JUDGED)
    smoothing_s: float = setting(0.06, "s", "duration over which speeds are averaged", JUDGED)
    goal_error: float = setting(0.01, "rad", "error below which a joint is at its goal", JUDGED)
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

    block_s: float = setting(
        1.0,
        "s",
        "distance at which moments and errors are independent; minimum duration of the recordings",
        DEVELOPED,
    )
    draws: int = setting(400, "1", "resamples", COST)
    bin_s: float = setting(0.25, "s", "bin width of the residual's autocorrelation", COST)
    blocks_min: int = setting(
        32,
        "1",
        "minimum number of blocks of a recording, whatever the correlation time of its residual",
        "derived: what shows in a tenth of them is drawn again in 19 of 20 resamples",
    )


@dataclass(frozen=True)
class Numerics:
    """When a gap or a cause is the simulator's own doing."""

    change: float = setting(0.1, "1", "relative change of the gap that counts", DEVELOPED)
    change_min: float = setting(0.005, "1", "minimum such change, over the motion", DEVELOPED)
    gain_left: float = setting(0.25, "1", "minimum remaining gain of a physical effect", DEVELOPED)
