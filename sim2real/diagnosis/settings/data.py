"""Settings of `diagnosis/data`: noise, windows, kinds of moments, the bootstrap."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class NoiseFloor:
    """The noise floor: resolution of the encoders, and scatter of repeated motions."""

    steps_min: int = setting(
        5, "1", "smallest number of different steps from which a resolution is inferred", JUDGED
    )
    whole_error: float = setting(
        0.02, "1", "largest deviation of a step from a whole number of encoder counts", JUDGED
    )
    slow_share: float = setting(
        0.3, "1", "slowest fraction of rows, which tells the noise of a reading", DEVELOPED
    )


@dataclass(frozen=True)
class Windows:
    """How logs are cut into windows, and which of their rows are compared.

    If every joint has a position servo, a window lasts at least twice as long as its warm-up.
    """

    warm_s: float = setting(
        0.4, "s", "simulated time before the first compared row of a window", DEVELOPED
    )
    longest_s: float = setting(
        3.0, "s", "longest window, unless the commands reverse slowly", DEVELOPED
    )
    windows_usual: int = setting(
        12, "1", "intended number of windows; more if they would exceed `longest_s`", DEVELOPED
    )
    windows_max: int = setting(
        40, "1", "number of windows above which slow motions get windows beyond `longest_s`", COST
    )
    state_s: float = setting(
        0.25, "s", "length of a window if no position servo corrects a joint's errors", DEVELOPED
    )
    unsure_s: float = setting(
        0.7, "s", "length of such a window if no speed is logged and the base is fixed", DEVELOPED
    )
    slowest_s: float = setting(12.0, "s", "longest window of slow motions", DEVELOPED)
    turn: float = setting(
        0.1,
        "1",
        "smallest reversal that counts, relative to the range of motion, or to the swings of a "
        "joint whose servo hunts",
        JUDGED,
    )
    kick_s: float = setting(
        0.3,
        "s",
        "time after a servo is switched on (logs lack the exact moment), and after its loop has "
        "hunted, that is not compared; time after a change of direction that belongs to the "
        "reversal",
        DEVELOPED,
    )
    reach: float = setting(
        0.25,
        "1",
        "largest shift of a window's start to a calm moment, relative to the window",
        JUDGED,
    )

    @property
    def shortest_s(self) -> float:
        """Shortest window if every joint has a position servo [s]."""
        return 2 * self.warm_s


@dataclass(frozen=True)
class Simulation:
    """How windows and pieces of logs are simulated."""

    error_max: float = setting(
        10.0, "1", "limit to which errors are clipped, relative to the joint's spread", JUDGED
    )
    piece_s: float = setting(
        5.0, "s", "length of the pieces of a log that are replayed to test the model", COST
    )
    pieces: int = setting(4, "1", "number of these pieces", COST)
    strengths: tuple[float, ...] = setting(
        (0.5, 0.2, 0.07), "1", "motor strengths at which loads are simulated, decreasing", DEVELOPED
    )
    heat_passes: int = setting(
        2, "1", "number of times that loads are simulated again with weaker motors", DEVELOPED
    )


@dataclass(frozen=True)
class Regimes:
    """The regimes of motion in which an error may occur, such as reversals or high load."""

    rest_speed: float = setting(0.05, "rad/s", "speed below which a joint is at rest", JUDGED)
    held_s: float = setting(
        0.5, "s", "time after which an unchanged command counts as held", JUDGED
    )
    smoothing_s: float = setting(0.06, "s", "width of the moving average of speeds", JUDGED)
    goal_error: float = setting(
        0.01, "rad", "position error below which a joint is at its goal", JUDGED
    )
    load_none: float = setting(
        0.1, "1", "fraction of the largest gravity load below which a joint is unloaded", JUDGED
    )
    rare: float = setting(
        0.98, "1", "quantile used as the maximum; small values are below half of it", JUDGED
    )


@dataclass(frozen=True)
class Bootstrap:
    """The block bootstrap that computes intervals."""

    block_s: float = setting(
        1.0,
        "s",
        "shortest block, and shortest total duration of the logs; also the time for which "
        "equal commands make a repeated motion",
        DEVELOPED,
    )
    draws: int = setting(400, "1", "number of resamples", COST)
    blocks_min: int = setting(
        32,
        "1",
        "smallest number of blocks; it limits their length",
        "derived: what shows in a tenth of them is drawn again in 19 of 20 resamples",
    )


@dataclass(frozen=True)
class Numerics:
    """When a gap, or an effect that closes it, is due to the simulator's numerics."""

    change: float = setting(
        0.1, "1", "smallest change of gap or motion that matters, relative to the gap", DEVELOPED
    )
    change_min: float = setting(
        0.005, "1", "smallest change of the motion that matters, relative to the motion", DEVELOPED
    )
    gain_left: float = setting(
        0.25, "1", "smallest fraction of an effect's gain left with better numerics", DEVELOPED
    )
