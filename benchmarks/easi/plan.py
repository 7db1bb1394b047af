"""What the study compares: tasks, ways to a training distribution, and where each run lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from envs.effects import load_effects
from envs.simulation import Simulation
from envs.tasks import BallBalance, CartPole, EasiAnt, Quad8, Task

ROOT = Path(__file__).parents[2]
ASSETS, SHIFTS = ROOT / "envs" / "assets", ROOT / "conf" / "shift"


@dataclass(frozen=True)
class Study:
    """A task of the study."""

    task: type[Task]  # makes it
    experiment: str  # that trains a policy on it
    model: str  # file of its robot
    params: str  # choice of conf/params: what uniform randomization draws
    # the seed's figures, mean and deviation over runs, by row
    published: Mapping[str, tuple[float, float]]
    identify: tuple[str, ...] = ()  # settings of every EASI run
    target: str | None = None  # the first target, if that is not the robot as its model says
    rows: tuple[str, ...] = ()  # names of its rows; none: all
    words: Mapping[str, str] = field(default_factory=dict)  # what these are, if not the usual
    note: str = ""  # on what its returns are

    @property
    def path(self) -> Path:
        """The robot's model."""
        return ASSETS / self.model


def _published(*figures: tuple[float, float]) -> dict[str, tuple[float, float]]:
    """Return the seed's figures of uniform randomization and of EASI with 1 to 200 trajectories."""
    rows = ("udr", "easi_1", "easi_50", "easi_100", "easi_200")
    return dict(zip(rows, figures, strict=True))


STUDIES: dict[str, Study] = {
    "cartpole": Study(
        CartPole,
        "easi_cartpole",
        "cartpole.xml",
        "cartpole",
        _published((161.3, 15.3), (185.1, 3.1), (182.7, 2.7), (181.1, 4.4), (182.9, 4.3)),
        ("identify.score.updates=10",),  # half of the other tasks', as published
    ),
    "ant": Study(
        EasiAnt,
        "easi_ant_ppo",
        "easi_ant.xml",
        "easi_ant",
        _published((557.4, 55.6), (724.2, 7.5), (747.0, 25.0), (703.1, 63.1), (724.0, 31.5)),
        ("identify.search.population=100",),  # a third of the published
    ),
    "ball_balance": Study(
        BallBalance,
        "easi_ball_balance_ppo",
        "ball_balance.xml",
        "ball_balance",
        _published((226.9, 61.7), (360.1, 53.8), (421.3, 26.1), (428.5, 16.9), (393.1, 60.5)),
        ("identify.search.population=100",),  # a third of the published
    ),
    "quad8": Study(  # in the place of the seed's Go2, whose return is another one
        Quad8,
        "quad8_es",
        "quad8.xml",
        "quad8_servos",
        _published((0.62, 0.25), (0.44, 0.28), (0.80, 0.06), (0.72, 0.05), (0.78, 0.02)),
        target="servos",
        rows=("udr", "oracle", "easi_1", "easi_50", "easi_100", "easi_200"),
        words={"udr": "the ranges of params=quad8_servos", "oracle": "what the robot hides"},
        note=" The robot is emulated, ten episodes of each policy; the seed's return is Go2's.",
    ),
}


@dataclass(frozen=True)
class Row:
    """A way to the robots of a training."""

    name: str  # of it and of its folder
    words: str  # what it is
    # choice of conf/identify that finds the distribution; None for none
    identify: str | None = None
    budget: int = 200  # trajectories that it is given
    source: str | None = None  # row whose distribution it uses in its own way; None for none


ROUNDS: tuple[tuple[Row, ...], ...] = (  # the most telling first
    (
        Row("udr", "uniform randomization, a third to three times the target"),
        Row("oracle", "the target itself"),
        Row("easi_200", "EASI, robust critic, 200 trajectories", "easi"),
    ),
    (
        Row("narrow", "EASI's final width about the prior's mean", source="easi_200"),
        Row("point", "EASI's mean alone", source="easi_200"),
        Row("tuned", "trained on from udr, on the target, for the steps of 200 trajectories"),
        Row("paper_200", "EASI as published, 200 trajectories", "easi_paper"),
    ),
    (
        Row("easi_1", "EASI, robust critic, 1 trajectory", "easi", 1),
        Row("easi_50", "EASI, robust critic, 50 trajectories", "easi", 50),
        Row("easi_100", "EASI, robust critic, 100 trajectories", "easi", 100),
    ),
)
ROWS = {row.name: row for rows in ROUNDS for row in rows}
ENDED = (  # rows whose figures are those of the tag
    Row("garat", "GARAT: the prior's mean, actions changed by 200 trajectories, at studies-1"),
)


@dataclass(frozen=True)
class Plan:
    """What to run and where."""

    name: str  # of the task
    rows: Sequence[str]  # names of those that are wanted
    seeds: Sequence[int]  # of training
    out: Path  # folder of the runs
    results: Path  # folder of tables and pictures
    frames: int | None = None  # environment steps of a training; None for the experiment's own
    overrides: Sequence[str] = ()  # further settings of every training
    identify: Sequence[str] = ()  # further settings of every EASI run
    # another target than the robot as its model says: conf/shift/<task>_<target>.yaml
    target: str | None = None

    @property
    def study(self) -> Study:
        """The task."""
        return STUDIES[self.name]

    @property
    def label(self) -> str:
        """The task and its target, as folders, tables and pages call them."""
        return self.name if self.target is None else f"{self.name}_{self.target}"

    @property
    def effects(self) -> Path | None:
        """What makes the target of the task's robot; None for the robot itself."""
        return None if self.target is None else SHIFTS / f"{self.label}.yaml"

    @property
    def home(self) -> Plan:
        """The study of the robot as its model says, where uniform randomization is trained."""
        return replace(self, target=None)

    def folder(self, seed: int, *names: str) -> Path:
        """Return the folder of a run."""
        return self.out / self.label / f"seed{seed}" / Path(*names)

    def training(self, name: str, seed: int) -> Path:
        """Return the folder of a row's training."""
        parts = (name, "policy") if self.study.target else (name,)
        return (self.home if name == "udr" else self).folder(seed, *parts)


def targets(name: str) -> list[str]:
    """Return the further targets that a task has."""
    return sorted(f.stem.removeprefix(f"{name}_") for f in SHIFTS.glob(f"{name}_*.yaml"))


def truth(plan: Plan, effects: tuple) -> dict[str, float]:
    """Return the target's values of some effects' parameters, by name.

    NaN where the target gives a value in another way, such as an addition to a mass that is scaled.
    """
    made = plan.study.task()
    space = Simulation(made, 1, effects, 1).space
    hows = {effect.label(): effect.how for effect in effects}
    given = [*made.fixed(), *(load_effects(plan.effects) if plan.effects else ())]
    own = {e.label(): v[0] if e.how == hows.get(e.label()) else np.nan for e, v in given}
    return {p.name: float(own.get(p.name, p.neutral)) for p in space.parameters}
