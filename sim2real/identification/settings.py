"""The settings of an identification that are not arguments of classes in `conf/identify`."""

from dataclasses import dataclass

from sim2real.diagnosis.settings import setting

JUDGED = "judgement; not studied"
COST = "computing time: a finer value changes the answer little and costs more"


@dataclass(frozen=True)
class Settings:
    """The settings, with unit, meaning and origin."""

    interval_factor: float = setting(
        3.0, "1", "width of the prior, in intervals of a report", "convention: design, section 10"
    )
    held_every: int = setting(4, "1", "every so manieth episode or piece is held out", JUDGED)
    held_episodes: int = setting(
        4, "1", "episodes from which whole ones are held out", "derived: one of them can be spared"
    )
    stretch: int = setting(
        10, "1", "pieces held out together where episodes are not", "derived: neighbours are alike"
    )
    difference: float = setting(
        5e-3, "1", "step of central differences, in widths of the prior", COST
    )
    resolution: float = setting(
        1e-4, "1", "error of a simulation, of a joint's own motion", "judgement: of its time step"
    )
    rounds: int = setting(4, "1", "Gauss-Newton steps of each episode's own values", COST)
    dampings: tuple[float, ...] = setting(
        (0.0, 0.1, 1.0), "1", "dampings tried in each step, of the curvature", JUDGED
    )
    longest_step: float = setting(1.0, "1", "of such a step, in deviations of the prior", JUDGED)
    known: float = setting(
        0.5, "1", "directions whose estimate is narrowed by less are flat, of the prior", JUDGED
    )
    weight: float = setting(0.2, "1", "least weight of a parameter that names a direction", JUDGED)
    doubt: float = setting(
        0.8,
        "1",
        "part of what is left of the gap, beyond noise, that may act like a parameter; a deviation",
        "set by hand: holds the hidden values of the emulated bench, tests/sim2real/identification",
    )
    hold: float = setting(
        0.2,
        "1",
        "the same while values are looked for from far away (`nearby`); a deviation",
        "set by hand: of 0.1 to 0.8 nearest to what an emulated quad8 hides",
    )
    em_rounds: int = setting(500, "1", "rounds of the random effects' EM at most", COST)
    em_change: float = setting(1e-6, "1", "change at which it stops", COST)
    draws: int = setting(100, "1", "draws under which held-out logs are replayed", COST)
    band: float = setting(0.9, "1", "share of the draws within the band", "convention: 90 %")
    compared: int = setting(20_000, "1", "readings at most that bands are compared with", COST)
    border: float = setting(
        0.02, "1", "a mean this near an end of its prior is at the border, of its width", JUDGED
    )
    step_rows: int = setting(4096, "1", "transitions simulated at once", COST)
    uneven: float = setting(0.01, "1", "rows may be this uneven, of their interval", JUDGED)


DEFAULT = Settings()
