"""The settings of an identification that are not arguments of classes in `conf/identify`."""

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, JUDGED, setting


@dataclass(frozen=True)
class Settings:
    """How `identify` fits parameters and tests the result on held-out logs."""

    interval_factor: float = setting(
        3.0,
        "width of the prior, relative to the interval in a report",
        "convention: design, section 10",
    )
    held_every: int = setting(
        4, "number of episodes (or stretches), of which one is held out", JUDGED
    )
    held_episodes: int = setting(
        4,
        "smallest number of episodes for which whole episodes are held out",
        "derived: one of them can be spared",
    )
    stretch: int = setting(
        10,
        "number of consecutive transitions in a stretch; with too few episodes, stretches "
        "are held out",
        "derived: neighbours are alike",
    )
    difference: float = setting(
        5e-3, "step of central differences, relative to the width of the prior", COST
    )
    resolution: float = setting(
        1e-4,
        "smallest error that a simulation resolves, relative to a joint's spread",
        "judgement: of its time step",
    )
    rounds: int = setting(4, "largest number of Gauss-Newton steps", COST)
    dampings: tuple[float, ...] = setting(
        (0.0, 0.1, 1.0),
        "dampings tried in each step, relative to the diagonal of the curvature",
        JUDGED,
    )
    longest_step: float = setting(1.0, "longest step, in standard deviations of the prior", JUDGED)
    known: float = setting(
        0.5,
        "relative reduction of the prior's standard deviation that identifies a direction",
        JUDGED,
    )
    weight: float = setting(
        0.2, "smallest weight of a parameter named in an unidentified direction", JUDGED
    )
    doubt: float = setting(
        0.8,
        "fraction of the residual beyond noise that may look like a change of parameters "
        "(standard deviation)",
        "set by hand: holds the hidden values of the emulated bench, tests/sim2real/identification",
    )
    hold: float = setting(
        0.2,
        "the same fraction during the search for values by `identify=nearby`",
        "set by hand: of 0.1 to 0.8 nearest to what an emulated quad8 hides",
    )
    em_rounds: int = setting(500, "largest number of EM iterations for random effects", COST)
    em_change: float = setting(1e-6, "relative change of the covariance at which EM stops", COST)
    draws: int = setting(
        100, "number of parameter draws with which held-out logs are replayed", COST
    )
    band: float = setting(0.9, "fraction of the draws inside the band", "convention: 90 %")
    compared: int = setting(
        20_000, "largest number of readings that are compared with the band", COST
    )
    border: float = setting(
        0.02,
        "largest reported distance of a mean from a bound of its prior, relative to the "
        "prior's width",
        JUDGED,
    )
    step_rows: int = setting(4096, "number of transitions simulated in one batch", COST)
    uneven: float = setting(
        0.01, "largest deviation of a row interval from the median, relative to it", JUDGED
    )


DEFAULT = Settings()
