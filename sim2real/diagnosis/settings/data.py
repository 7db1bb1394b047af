"""Settings of `diagnosis/data`: noise, windows, kinds of moments, the bootstrap."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class NoiseFloor:
    """The noise floor: resolution of the encoders, and scatter of repeated motions."""

    whole_error: float = setting(
        0.02, "largest deviation of a step from a whole number of encoder counts", JUDGED
    )
    slow_share: float = setting(
        0.3, "slowest fraction of rows, which tells the noise of a reading", DEVELOPED
    )


@dataclass(frozen=True)
class Windows:
    """How logs are cut into windows, and which of their rows are compared.

    If every joint has a position servo, a window lasts at least twice as long as its warm-up.
    """

    warm_s: float = setting(
        0.4, "simulated time before the first compared row of a window", DEVELOPED
    )
    longest_s: float = setting(3.0, "longest window, unless the commands reverse slowly", DEVELOPED)
    windows_usual: int = setting(
        12, "intended number of windows; more if they would exceed `longest_s`", DEVELOPED
    )
    windows_min: int = setting(
        40,
        "smallest number of windows that are left where slow motions lengthen them beyond "
        "`longest_s`, and of bootstrap blocks that are left where coherent errors lengthen them",
        "derived: what shows in a tenth of the blocks is drawn again in 19 of 20 resamples",
    )
    state_s: float = setting(
        0.25, "length of a window if no position servo corrects a joint's errors", DEVELOPED
    )
    unsure_s: float = setting(
        0.7, "length of such a window if no speed is logged and the base is fixed", DEVELOPED
    )
    slowest_s: float = setting(12.0, "longest window of slow motions", DEVELOPED)
    turn: float = setting(
        0.1,
        "smallest reversal that counts, relative to the range of motion, or to the swings of a "
        "joint whose servo hunts",
        JUDGED,
    )
    kick_s: float = setting(
        0.3,
        "time after a servo is switched on (logs lack the exact moment), and after its loop has "
        "hunted, that is not compared; time after a change of direction that belongs to the "
        "reversal; time after which an unchanged command counts as held; time before and "
        "after an obstruction that is excluded as well; width of the moving average that is "
        "subtracted to see fast oscillations",
        DEVELOPED,
    )
    reach: float = setting(
        0.25, "largest shift of a window's start to a calm moment, relative to the window", JUDGED
    )

    @property
    def shortest_s(self) -> float:
        """Shortest window if every joint has a position servo [s]."""
        return 2 * self.warm_s


@dataclass(frozen=True)
class Simulation:
    """How windows and pieces of logs are simulated."""

    error_max: float = setting(
        10.0, "limit to which errors are clipped, relative to the joint's spread", JUDGED
    )
    piece_s: float = setting(
        5.0, "length of the pieces of a log that are replayed to test the model", COST
    )
    strengths: tuple[float, ...] = setting(
        (0.5, 0.2, 0.07), "motor strengths at which loads are simulated, decreasing", DEVELOPED
    )


@dataclass(frozen=True)
class Regimes:
    """The regimes of motion in which an error may occur, such as reversals or high load."""

    rest_speed: float = setting(0.05, "speed below which a joint is at rest", JUDGED, unit="rad/s")
    smoothing_s: float = setting(0.06, "width of the moving average of speeds", JUDGED)
    goal_error: float = setting(
        0.01, "position error below which a joint is at its goal", JUDGED, unit="rad"
    )


@dataclass(frozen=True)
class Bootstrap:
    """The block bootstrap that computes intervals."""

    block_s: float = setting(
        1.0,
        "shortest block, and shortest total duration of the logs; also the time for which "
        "equal commands make a repeated motion",
        DEVELOPED,
    )
    draws: int = setting(400, "number of resamples", COST)


@dataclass(frozen=True)
class Numerics:
    """When a gap, or an effect that closes it, is due to the simulator's numerics."""

    change: float = setting(
        0.1, "smallest change of gap or motion that matters, relative to the gap", DEVELOPED
    )
    change_min: float = setting(
        0.005, "smallest change of the motion that matters, relative to the motion", DEVELOPED
    )
