"""Settings of `diagnosis/inference`: likelihood, fit and decision, and where a gap lies."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, ROUNDING, setting

GRID = "derived: the grid spans what a window resolves, from a few rows to its length"


@dataclass(frozen=True)
class Inference:
    """What no model knows, how values are fitted, and what an answer has to win."""

    rows_max: int = setting(64, "1", "maximum number of compared rows per window", COST)
    negligible: float = setting(
        5e-4, "1", "negligible error, relative to the spread of a joint's motion", JUDGED
    )
    correlations_s: tuple[float, ...] = setting(
        (0.03, 0.2, 1.2), "s", "correlation times of the discrepancy", GRID
    )
    octaves: int = setting(
        15,
        "1",
        "doublings of the discrepancy's size, starting at half the noise of a reading",
        "derived: 2^14 noise sizes are beyond the worst model's error",
    )
    freedom: float = setting(
        4.0,
        "1",
        "degrees of freedom of the Student's t distribution of a window's discrepancy",
        "convention: Lange et al. (1989), robust and still with a variance",
    )
    usual: float = setting(
        0.02,
        "1",
        "standard deviation of the factor on any nominal parameter",
        "convention: a few per cent",
    )
    law: float = setting(
        0.05,
        "1",
        "standard deviation of the factor on a value, because the effect's model is not exact",
        "measured: rms of `error` in `thirdparty_55.csv` is 0.06, with what noise adds",
    )
    factors_max: int = setting(
        12, "1", "maximum number of directions of these errors, the largest first", COST
    )
    turns: int = setting(4, "1", "sweeps over the joints when their discrepancies are fitted", COST)
    difference: float = setting(0.03, "1", "finite difference, relative to a value", COST)
    difference_min: float = setting(
        0.01, "1", "minimum finite difference, relative to a step", COST
    )
    damping: float = setting(
        1e-4, "1", "first damping of a Gauss-Newton step, relative to the curvature", COST
    )
    damping_ratio: float = setting(
        1e4,
        "1",
        "ratio of the two dampings that are tried side by side",
        "derived: a whole step, and half of one where it goes too far",
    )
    rounds: int = setting(8, "1", "maximum number of Gauss-Newton steps", COST)
    settled: float = setting(0.5, "1", "gain of a step [nats] below which a fit has ended", COST)
    reach: float = setting(
        5.0, "1", "standard deviation of a value's prior, relative to its largest probe", JUDGED
    )
    implausible: float = setting(
        20.0,
        "1",
        "multiple of the largest probe (which depends on the robot's size) beyond which a value "
        "explains nothing",
        JUDGED,
    )
    ridge: float = setting(1e-9, "1", "added to a curvature, relative to its diagonal", ROUNDING)
    glance_s: float = setting(
        15.0, "s", "duration of the screened windows, at most half of all", COST
    )
    first_s: float = setting(
        18.0, "s", "duration of the windows for a first test of mistakes in the log", COST
    )
    coarse_s: float = setting(5e-3, "s", "largest time step of the screening", COST)
    glances: int = setting(
        2,
        "1",
        "Gauss-Newton steps of the best proposals of the screening; half of them are fitted "
        "further",
        COST,
    )
    refits: int = setting(12, "1", "number of fitted proposals, the best of the screening", COST)
    promising: int = setting(
        24,
        "1",
        "number of changes simulated in addition to a cause, the best of the screening",
        COST,
    )
    alike: int = setting(4, "1", "number of changes fitted instead of each member", COST)
    members_max: int = setting(
        4,
        "1",
        "maximum number of members of a hypothesis",
        "derived: more are a fit and no explanation (schema)",
    )
    block: int = setting(
        2, "1", "neighbouring windows that the bootstrap draws together", "convention: Kuensch 1989"
    )
    draws: int = setting(2000, "1", "bootstrap draws of the windows", COST)
    level: float = setting(0.05, "1", "error probability of one-sided bounds", "convention: 95 %")
    equivalence_tolerance: float = setting(
        0.15,
        "1",
        "nats per reading that a free discrepancy may still gain in an explanation",
        JUDGED,
    )
    most: float = setting(
        0.5,
        "1",
        "fraction by which the causes of an explanation must reduce the errors",
        "derived: most of it, and not what is put down to usual errors",
    )
    moments: float = setting(
        0.1,
        "1",
        "fraction of windows that may keep a residual, such as a contact or a hunting servo",
        JUDGED,
    )
    temperature: float = setting(
        0.03,
        "1",
        "nats per row of all joints that change the odds of two hypotheses by a factor of e: "
        "rows are not independent evidence",
        JUDGED,
    )
    equivalents_max: int = setting(
        3,
        "1",
        "maximum number of names of one cause in a report",
        "derived: more are no answer (schema)",
    )
    rivals: int = setting(5, "1", "hypotheses compared with the best at the end", COST)


@dataclass(frozen=True)
class Cogging:
    """Ripples that the error shows."""

    counts: tuple[float, float] = setting(
        (3.0, 150.0), "1", "fewest and most ripples per turn", JUDGED
    )
    finest: float = setting(4.0, "1", "counts tried for each one that the range resolves", JUDGED)
    readings: float = setting(1.5, "1", "minimum encoder counts in half a ripple", JUDGED)
    counts_probed: int = setting(3, "1", "counts that are simulated", COST)
    sizes: tuple[float, ...] = setting(
        (1.0, 2.5), "1", "simulated amplitudes, relative to the one in the error", DEVELOPED
    )
    slow: float = setting(0.7, "rad/s", "speed above which rows are ignored", DEVELOPED)
    turned: float = setting(0.8, "rad", "minimum range of a joint with ripples", DEVELOPED)
    trend_order: int = setting(3, "1", "degree of the polynomial trend under a ripple", DEVELOPED)
    stiffness_min: float = setting(0.1, "N·m/rad", "minimum stiffness of a servo", JUDGED)
    rows_min: int = setting(50, "1", "rows needed", JUDGED)
    off_share: float = setting(
        0.05, "1", "fraction of time without torque above which windows are left out", JUDGED
    )


@dataclass(frozen=True)
class Locating:
    """Where the gap lies."""

    lift: float = setting(
        1.2,
        "1",
        "smallest reported ratio of the fraction of the error to that of the time",
        JUDGED,
    )
    share_min: float = setting(0.2, "1", "smallest reported fraction of the error", JUDGED)
    named_max: int = setting(4, "1", "kinds of moments reported per joint", JUDGED)
    edges_hz: tuple[float, ...] = setting(
        (0.0, 0.5, 2.0, 5.0, 15.0), "Hz", "edges of the frequency bands", JUDGED
    )
