"""Settings of `diagnosis/attribution`: fits, and the first look at every candidate."""

from __future__ import annotations

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, ROUNDING, setting

GLANCE = "judgement: kept the exact top five in six cases (benchmarks.screening at studies-1)"


@dataclass(frozen=True)
class Fitting:
    """The damped Gauss-Newton steps of every fit."""

    clock_s: float = setting(
        1e-3, "s", "error of stamps where a row has one for all readings", DEVELOPED
    )
    stamped_steps: float = setting(
        0.5,
        "1",
        "clock's error in simulation steps where each reading has its own stamp",
        "derived: a command acts from the next step on, half a step late on average",
    )
    timing_s: float = setting(60.0, "s", "windows that tell the clock of a held-out fit", COST)
    dampings: tuple[float, ...] = setting(
        (0.0, 0.3, 3.0), "1", "dampings tried in a step, of the curvature", DEVELOPED
    )
    trusted: float = setting(
        0.5,
        "1",
        "fall of the squared error, of what a whole step promises, from which no damping is tried",
        "judgement: between the quarter and three quarters that trust-region methods use",
    )
    still: float = setting(
        1e-3, "1", "fall that a whole step promises, below which no damping is tried either", COST
    )
    difference: float = setting(0.06, "1", "finite difference, of a typical change", DEVELOPED)
    difference_min: float = setting(
        0.3, "1", "least size a difference is taken of, of a typical change", DEVELOPED
    )
    settled: float = setting(0.01, "1", "relative gain below which a fit has settled", COST)
    rounds: int = setting(3, "1", "steps of a fit unless its caller says otherwise", COST)
    ridge: float = setting(1e-12, "1", "added to the curvature, of its trace", ROUNDING)
    damping_min: float = setting(1e-6, "1", "added to each damping", ROUNDING)


@dataclass(frozen=True)
class Screening:
    """The first look at every candidate."""

    ridge: float = setting(
        1e-3, "1", "added to a change's square, so that look-alikes do not cancel", DEVELOPED
    )
    ridge_floor: float = setting(1e-15, "1", "added besides", ROUNDING)
    probed_max: int = setting(40, "1", "candidates looked at beside known effects", COST)
    coarse_s: float = setting(5e-3, "s", "time step of a first glance, at most", COST)
    coarse_off: float = setting(
        0.1, "1", "error of that step, of the motion, from which there is no glance", GLANCE
    )
    kept_max: int = setting(16, "1", "candidates probed after a glance", GLANCE)
    rows_max: int = setting(600, "1", "windows under a probe that are in memory at once", COST)
    probes_kept: int = setting(2, "1", "probes of each that are simulated then", GLANCE)
    scale_between: tuple[float, float] = setting(
        (0.4, 2.2), "1", "scaling of a response that has neighbours", DEVELOPED
    )
    scale_beyond: tuple[float, float] = setting(
        (0.05, 6.0), "1", "scaling of the smallest and the largest response", DEVELOPED
    )
    change_min: float = setting(
        1e-6, "1", "response, of the squared error, below which nothing changes", ROUNDING
    )
    pair_scale: tuple[float, float] = setting(
        (0.3, 3.0), "1", "scaling of a response in a pair", DEVELOPED
    )
    pair_ridge: float = setting(1e-9, "1", "least determinant of a pair, relative", ROUNDING)
    pair_ridge_floor: float = setting(1e-30, "1", "least determinant of a pair", ROUNDING)
    pair_twins: float = setting(
        1e-6,
        "1",
        "difference of what pairs undo, of the squared error, below which they are one",
        ROUNDING,
    )
    pairs_ranked: int = setting(400, "1", "pairs of responses kept in the ranking", COST)
