"""Settings of `diagnosis/inference`: likelihood, fit and decision, and where a gap lies."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, ROUNDING, setting

GRID = "derived: the grid spans what a window resolves, from a few rows to its length"


@dataclass(frozen=True)
class Inference:
    """What no model knows, how values are fitted, and what an answer has to win."""

    rows_max: int = setting(64, "1", "rows of a window that are compared, spread evenly", COST)
    negligible: float = setting(
        5e-4, "1", "error that matters to nobody, of the spread of a joint's motion", JUDGED
    )
    correlations_s: tuple[float, ...] = setting(
        (0.03, 0.2, 1.2), "s", "correlation times of the discrepancy", GRID
    )
    octaves: int = setting(
        15,
        "1",
        "doublings of the discrepancy's size, from half the noise of a reading",
        "derived: 2^14 noise sizes are beyond the worst model's error",
    )
    freedom: float = setting(
        4.0,
        "1",
        "degrees of freedom of the Student distribution of a window's discrepancy",
        "convention: Lange et al. (1989), robust and still with a variance",
    )
    usual: float = setting(
        0.02,
        "1",
        "standard deviation of the factor by which any nominal parameter is off",
        "convention: a few per cent",
    )
    law: float = setting(
        0.05,
        "1",
        "standard deviation of the factor by which a value is off since its law is not the robot's",
        "studied: relative errors of 21 values, robots of another engine (`thirdparty_55`)",
    )
    factors_max: int = setting(
        12, "1", "directions of these errors that are kept, by their size", COST
    )
    turns: int = setting(4, "1", "sweeps over the joints' discrepancies in training", COST)
    difference: float = setting(0.03, "1", "finite difference, of a value", COST)
    difference_min: float = setting(0.01, "1", "finite difference at least, of a step", COST)
    damping: float = setting(
        1e-4, "1", "first damping of a Gauss-Newton step, of the curvature", COST
    )
    damping_ratio: float = setting(
        1000.0, "1", "ratio of the two dampings that are tried side by side", COST
    )
    rounds: int = setting(8, "1", "Gauss-Newton steps at most", COST)
    settled: float = setting(0.5, "1", "gain of a step [nats] below which a fit has settled", COST)
    reach: float = setting(
        5.0, "1", "standard deviation of a value, in the largest of its probes", JUDGED
    )
    implausible: float = setting(
        20.0,
        "1",
        "times the largest probe, which effects take from the robot's own sizes, beyond which a "
        "value explains nothing",
        JUDGED,
    )
    ridge: float = setting(1e-9, "1", "added to a curvature, of its diagonal", ROUNDING)
    glance_s: float = setting(
        15.0, "s", "windows that proposals are screened on, of half of all at most", COST
    )
    first_s: float = setting(18.0, "s", "windows of a first look at mistakes of the log", COST)
    coarse_s: float = setting(5e-3, "s", "time step there, at most", COST)
    glances: int = setting(
        2, "1", "Gauss-Newton steps there of those that screen best; half of them go on", COST
    )
    refits: int = setting(12, "1", "proposals that are fitted, those that screen best", COST)
    promising: int = setting(
        40, "1", "changes that are simulated with a cause, those that screen best", COST
    )
    alike: int = setting(4, "1", "changes that are fitted in the place of each member", COST)
    members_max: int = setting(
        4, "1", "members of a hypothesis", "derived: more are a fit and no explanation (schema)"
    )
    block: int = setting(
        2, "1", "neighbouring windows that a bootstrap draws together", "convention: Kuensch 1989"
    )
    draws: int = setting(2000, "1", "bootstrap draws of the windows", COST)
    level: float = setting(
        0.05, "1", "probability of error of each one-sided bound", "convention: 95 %"
    )
    equivalence_tolerance: float = setting(
        0.15,
        "1",
        "nats a reading that what is left may still gain in an explanation",
        JUDGED,
    )
    most: float = setting(
        0.5,
        "1",
        "share by which causes shorten errors where they explain a gap",
        "derived: most of it, and not what is put down to usual errors",
    )
    moments: float = setting(
        0.1,
        "1",
        "share of the windows in which something may be left: a contact, a servo that goes on",
        JUDGED,
    )
    temperature: float = setting(
        0.03,
        "1",
        "nats a row, of all joints, that change the odds of two hypotheses by e: rows are no "
        "independent evidence",
        JUDGED,
    )
    equivalents_max: int = setting(
        3, "1", "names of one cause that a report lists", "derived: more are no answer (schema)"
    )
    rivals: int = setting(5, "1", "hypotheses that are compared with the best at the end", COST)


@dataclass(frozen=True)
class Cogging:
    """Ripples that the error shows."""

    counts: tuple[float, float] = setting(
        (3.0, 150.0), "1", "ripples in a turn: fewest and most", JUDGED
    )
    finest: float = setting(4.0, "1", "counts tried in a difference that the span resolves", JUDGED)
    readings: float = setting(1.5, "1", "encoder counts in half a ripple, at least", JUDGED)
    counts_probed: int = setting(3, "1", "counts probed by simulation", COST)
    sizes: tuple[float, ...] = setting(
        (1.0, 2.5), "1", "probed amplitudes, of the one in the error", DEVELOPED
    )
    slow: float = setting(0.7, "rad/s", "faster rows are ignored", DEVELOPED)
    turned: float = setting(0.8, "rad", "a joint that turned less shows only a mean", DEVELOPED)
    trend_order: int = setting(3, "1", "degree of the polynomial under a ripple", DEVELOPED)
    stiffness_min: float = setting(0.1, "N·m/rad", "least stiffness of a servo", JUDGED)
    rows_min: int = setting(50, "1", "rows needed", JUDGED)
    off_share: float = setting(0.05, "1", "windows without torque for longer are left out", JUDGED)


@dataclass(frozen=True)
class Locating:
    """Where the gap lies."""

    lift: float = setting(
        1.2, "1", "share of the error, of its share of the time, that is worth naming", JUDGED
    )
    share_min: float = setting(0.2, "1", "share of the error worth naming", JUDGED)
    named_max: int = setting(4, "1", "kinds of moments named a joint", JUDGED)
    edges_hz: tuple[float, ...] = setting(
        (0.0, 0.5, 2.0, 5.0, 15.0), "Hz", "edges of the frequency bands", JUDGED
    )
