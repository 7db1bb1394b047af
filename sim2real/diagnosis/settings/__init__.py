"""Every number that steers a diagnosis, by stage, with unit, meaning and origin.

    from dataclasses import replace
    from sim2real.diagnosis.settings import DEFAULT, Inference
    diagnose("logs/", "arm.xml", settings=replace(DEFAULT, inference=Inference(members_max=2)))

A report lists all of them in "How this was made".
"""

from dataclasses import dataclass, field

from sim2real.diagnosis.settings.base import TINY as TINY
from sim2real.diagnosis.settings.base import TINY_SQUARE as TINY_SQUARE
from sim2real.diagnosis.settings.base import Row as Row
from sim2real.diagnosis.settings.base import rows as rows
from sim2real.diagnosis.settings.closed_loop import ClosedLoopSettings
from sim2real.diagnosis.settings.comparison import Compared
from sim2real.diagnosis.settings.contract import Contract
from sim2real.diagnosis.settings.data import (
    Bootstrap,
    NoiseFloor,
    Numerics,
    Regimes,
    Simulation,
    Windows,
)
from sim2real.diagnosis.settings.experiment import Experiment
from sim2real.diagnosis.settings.ground import Ground
from sim2real.diagnosis.settings.inference import Cogging, Inference, Locating
from sim2real.diagnosis.settings.preflight import Hunting, Obstruction, Preflight


@dataclass(frozen=True)
class Settings:
    """The settings of all stages, in the order in which a log passes them."""

    obstruction: Obstruction = field(default_factory=Obstruction)
    hunting: Hunting = field(default_factory=Hunting)
    noise_floor: NoiseFloor = field(default_factory=NoiseFloor)
    windows: Windows = field(default_factory=Windows)
    ground: Ground = field(default_factory=Ground)
    simulation: Simulation = field(default_factory=Simulation)
    regimes: Regimes = field(default_factory=Regimes)
    bootstrap: Bootstrap = field(default_factory=Bootstrap)
    preflight: Preflight = field(default_factory=Preflight)
    contract: Contract = field(default_factory=Contract)
    numerics: Numerics = field(default_factory=Numerics)
    cogging: Cogging = field(default_factory=Cogging)
    inference: Inference = field(default_factory=Inference)
    locating: Locating = field(default_factory=Locating)
    experiment: Experiment = field(default_factory=Experiment)
    closed_loop: ClosedLoopSettings = field(default_factory=ClosedLoopSettings)
    compared: Compared = field(default_factory=Compared)


DEFAULT = Settings()
