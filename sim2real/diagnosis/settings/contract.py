"""Settings of `diagnosis/contract`: when a fault of the policy's interface is named."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class Contract:
    """When a rebuilt number differs from the logged one, and which explanation is named."""

    suspect: float = setting(
        0.01, "1", "misfit (RMS, of the number's spread) that is looked into", JUDGED
    )
    unexplained: float = setting(
        0.05, "1", "misfit that is reported even if nothing explains it", JUDGED
    )
    margin: float = setting(
        0.5,
        "1",
        "share of the described way's misfit that a named fault leaves at most",
        JUDGED,
    )
    left_max: float = setting(
        0.15, "1", "misfit that a named fault leaves at most, of the spread", JUDGED
    )
    floor: float = setting(
        2e-3, "1", "misfits below this share of the spread count as equal", JUDGED
    )
    effective_rows: int = setting(
        30, "1", "independent rows that a log counts as, in choosing between faults", JUDGED
    )
    price: float = setting(
        20.8,
        "nat",
        "gain in log likelihood that each further change must bring",
        "derived: 30 rows / 2 x ln 4, one number's RMS misfit halved",
    )
    free_price: float = setting(
        1.5, "1", "price of a change whose value is fitted, in those of one that is not", JUDGED
    )
    alike: float = setting(
        3.0, "nat", "explanations closer than this are named together", "derived: odds of 20"
    )
    set_max: int = setting(3, "1", "members of a set that are named", JUDGED)
    still: float = setting(
        0.01, "1", "a number that spreads less, in its unit before scaling, did not move", JUDGED
    )
    ages_max: int = setting(4, "1", "largest age of an observation or action tried, in steps", COST)
    ways_few: int = setting(
        4, "1", "other ways of a term up to which each is tried at every age", COST
    )
    holds: tuple[int, ...] = setting((2, 3, 4, 5), "1", "rows that a value is held, tried", JUDGED)
    filters: tuple[float, ...] = setting(
        (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), "1", "smoothing factors tried", COST
    )
    strides: tuple[int, ...] = setting((2, 3, 4), "1", "steps between a history's frames", JUDGED)
    rows_min: int = setting(20, "1", "rows below which nothing is judged", JUDGED)
    rows_few: int = setting(
        4, "1", "rows below which one number is left out where the guard cut the others", JUDGED
    )
    draws: int = setting(200, "1", "resamples that `sure` is counted over", COST)
    blocks: int = setting(20, "1", "blocks of rows that are resampled", JUDGED)
    rate_error: float = setting(0.1, "1", "disagreement of the rate and the stamps", JUDGED)
    gain_ratio: tuple[float, float] = setting(
        (0.8, 1.25), "1", "ratios of measured and described gains that agree", JUDGED
    )
    gain_share: float = setting(
        0.8, "1", "share of the torque's variance that a gain law must explain", JUDGED
    )
