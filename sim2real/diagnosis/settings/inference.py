"""Settings of `diagnosis/inference`: likelihood, fit and decision, and where a gap lies."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, ROUNDING, setting

GRID = "derived: the grid spans what a window resolves, from a few rows to its length"


@dataclass(frozen=True)
class Inference:
    """The likelihood of errors, the fit of explanations and the choice between them."""

    rows_max: int = setting(64, "largest number of rows of a window that are compared", COST)
    negligible: float = setting(
        5e-4, "smallest assumed noise of a reading, relative to the joint's spread", JUDGED
    )
    correlations_s: tuple[float, ...] = setting(
        (0.03, 0.2, 1.2), "correlation times of the discrepancy that are tried", GRID
    )
    octaves: int = setting(
        15,
        "doublings of the tried size of the discrepancy, from half the noise of a reading",
        "derived: 2^14 noise sizes are beyond the worst model's error",
    )
    freedom: float = setting(
        4.0,
        "degrees of freedom of the t distribution of a window's discrepancy",
        "convention: Lange et al. (1989), robust and still with a variance",
    )
    usual: float = setting(
        0.02,
        "relative standard deviation assumed for every parameter of the model",
        "convention: a few per cent",
    )
    law: float = setting(
        0.05,
        "relative standard deviation added to a value, because its effect's equation is "
        "approximate",
        "measured: rms of `error` in `thirdparty_55.csv` is 0.06, with what noise adds",
    )
    factors_max: int = setting(
        12, "largest number of principal components of the errors that `usual` causes", COST
    )
    turns: int = setting(
        4, "largest number of sweeps over the joints to fit their discrepancies", COST
    )
    difference: float = setting(0.03, "step of finite differences, relative to the value", COST)
    difference_min: float = setting(
        0.01, "smallest step of finite differences, relative to the largest probe", COST
    )
    damping: float = setting(
        1e-4, "first damping of Gauss-Newton steps, relative to the curvature", COST
    )
    damping_ratio: float = setting(
        1e4,
        "factor by which a failed step raises the damping, and a good one lowers it",
        "derived: after a whole step that goes too far, about half of one",
    )
    rounds: int = setting(8, "largest number of Gauss-Newton steps of a fit", COST)
    settled: float = setting(
        0.5, "gain [nats] below which a Gauss-Newton step fails; two in a row end a fit", COST
    )
    reach: float = setting(
        5.0, "standard deviation of a value's prior, relative to its largest probe", JUDGED
    )
    implausible: float = setting(
        20.0,
        "multiple of the largest probe beyond which a value is implausible and explains nothing",
        JUDGED,
    )
    ridge: float = setting(
        1e-9, "term added to a curvature matrix, relative to its diagonal", ROUNDING
    )
    judged_s: float = setting(
        90.0,
        "total length of the windows that are judged, evenly spread over longer recordings",
        COST,
    )
    glance_s: float = setting(
        15.0, "total length of the screened windows, at most half of all windows", COST
    )
    first_s: float = setting(
        18.0, "total length of the windows that are first tested for mistakes in the log", COST
    )
    coarse_s: float = setting(
        5e-3, "longest physics time step until the answer is fitted again", COST
    )
    coarse_noises: float = setting(
        20.0,
        "RMS change of the model as given by longer steps, which is taken off all errors as a "
        "constant; where it is larger, the model's own steps are used",
        COST,
        unit="noises",
    )
    glances: int = setting(
        2,
        "Gauss-Newton steps in the screened windows; then the better half of the proposals "
        "is fitted to all windows",
        COST,
    )
    refits: int = setting(
        10, "largest number of proposals of the screening that are fitted at once", COST
    )
    promising: int = setting(
        24,
        "number of changes, the best of the screening, that are combined with the causes so far",
        COST,
    )
    alike: int = setting(4, "number of similar changes that are tried in place of each cause", COST)
    members_max: int = setting(
        4,
        "largest number of causes in an explanation",
        "derived: more are a fit and no explanation (schema)",
    )
    block: int = setting(
        2,
        "number of neighbouring windows that the bootstrap draws together",
        "convention: Kuensch 1989",
    )
    draws: int = setting(2000, "number of bootstrap draws", COST)
    level: float = setting(
        0.05,
        "error probability of one-sided bounds, and of the test for usual errors of parameters",
        "convention: 95 %",
    )
    equivalence_tolerance: float = setting(
        0.15,
        "largest gain, in nats per reading, of a free discrepancy over a discrepancy of at most "
        "one encoder count, overall and at every joint, if the gap is explained",
        JUDGED,
    )
    most: float = setting(
        0.5,
        "smallest share of the errors beyond noise that is closed, for the verdict `explained`; "
        "smallest share of an effect's gain that is left with better numerics",
        "derived: most of it",
    )
    moments: float = setting(
        0.1,
        "fraction of the windows, those with the largest residuals, that may stay "
        "unexplained (contacts, hunting servos)",
        JUDGED,
    )
    temperature: float = setting(
        0.03,
        "nats per row that change the odds of two explanations by a factor of e (rows are "
        "not independent evidence)",
        JUDGED,
    )
    unlisted: float = setting(
        0.08,
        "prior odds that a gap is due to an effect that is not in the library",
        "tuned: `python -m benchmarks.confidence` on seven exams, which its text names",
    )
    equivalents_max: int = setting(
        3,
        "largest number of names of one cause in a report, its own included",
        "derived: more are no answer (schema)",
    )
    rivals: int = setting(
        5, "number of alternative explanations compared with the best one at the end", COST
    )


@dataclass(frozen=True)
class Cogging:
    """The search for torque ripples in the error of a joint."""

    count_max: float = setting(150.0, "largest number of ripples per turn", JUDGED)
    finest: float = setting(
        4.0, "number of trials per smallest resolvable difference in ripples per turn", JUDGED
    )
    counts_probed: int = setting(3, "number of best-fitting candidates that are simulated", COST)
    sizes: tuple[float, ...] = setting(
        (1.0, 2.5), "simulated amplitudes, relative to the one estimated from the error", DEVELOPED
    )
    slow: float = setting(0.7, "speed above which rows are ignored", DEVELOPED, unit="rad/s")


@dataclass(frozen=True)
class Locating:
    """Which regimes and frequency bands are reported for the error of a joint."""

    lift: float = setting(
        1.2,
        "smallest reported ratio of a regime's fraction of the error to its fraction of the time",
        JUDGED,
    )
    share_min: float = setting(0.2, "smallest reported fraction of the error in a regime", JUDGED)
    edges_hz: tuple[float, ...] = setting(
        (0.0, 0.5, 2.0, 5.0, 15.0),
        "edges of the frequency bands in which errors are reported",
        JUDGED,
    )
