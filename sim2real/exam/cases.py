"""The cases of an exam, drawn from one seed: what is hidden where, and how large.

    exam = Exam(robots=["bench1"], one=1, two=2, none=2, excluded=2, sample=None)
    outlines = exam.draw(seed=11)                   # kinds, robots, effects: no emulator yet
    exam.make(outlines[0], logs, key)               # places and sizes, found on the emulator

Every robot gets every effect equally often; sizes are such that the gap between the robot with and
without the effect is a drawn multiple, log-uniform between 3 and 30, of the floor: what the same
robot differs from itself under other noise, or one count of the encoder if that is more.

A case is two folders. Who diagnoses gets the one with the logs: `a.csv` and `b.csv`, two motions;
`a_again.csv`, the beginning of the first one driven again; `model.xml`; `task.json`. The other one
holds the key, and a log that nothing is fitted to.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from hardware.config import Robot
from hardware.errors import HardwareError
from hardware.log import read_log, write_log
from sim2real.exam.answer import TASK
from sim2real.exam.hiding import EFFECTS, moved, place_of
from sim2real.exam.hold import KEY, Examiner, Outline
from sim2real.exam.logs import drive, exam_robot, overall, plans
from sim2real.exam.measure import apart
from sim2real.exam.refit import withheld
from sim2real.exam.sizes import Hidden, entries, hide
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

Kind = Literal["one", "two", "none", "excluded"]
Wanted = tuple[str, str, tuple[str, ...]]  # kind, robot, effects
KINDS: tuple[Kind, ...] = ("one", "two", "none", "excluded")
REDRAWS = 8  # draws of other effects where a robot cannot show the first ones
LOCAL = tuple(effect for effect in EFFECTS if place_of(effect) == "joint")
ALIKE = (  # effects that no log of positions can separate: never hidden together
    {"command_delay", "observation_delay"},
    {"position_gain", "motor_strength", "supply_voltage"},
    {"link_mass", "payload", "center_of_mass", "gravity_tilt", "encoder_offset"},
)


@dataclass(frozen=True)
class Case:
    """The key of a case."""

    name: str  # the name of its folders
    kind: str  # what was withheld
    robot: str  # its name
    seed: int  # the seed of motions and noise
    # hidden effects, as entries of an effects.yaml, each with `joint` and its own `gap`
    truths: tuple[dict[str, Any], ...]
    gap: float  # RMS difference between the robot with and without them [rad]
    floor: float  # RMS difference of the robot from itself under other noise, or one count [rad]
    # what the nominal model leaves of the held-back motion with nothing hidden [rad]
    residue: float
    exclude: tuple[str, ...]  # effects that the diagnosis may not use
    joints: tuple[str, ...]  # the robot's joints, in the order of its servos
    bodies: dict[str, str]  # the joint that moves each body

    def write(self, folder: Path) -> None:
        """Write key.json into a folder."""
        write_text(folder / KEY, json.dumps(asdict(self), indent=1) + "\n")


def write_task(folder: Path, exclude: Sequence[str], effects: str | None = None) -> None:
    """Write a diagnosis's inputs other than logs; `effects` names a file of known effects there."""
    task = {"exclude": list(exclude), "effects": effects, "seed": 0}
    write_text(folder / TASK, json.dumps(task, indent=1) + "\n")


@dataclass(frozen=True)
class Exam(Examiner):
    """The numbers of cases by kind.

    Raises:
        Sim2RealError: no robot, a negative number, or no case at all.
    """

    robots: Sequence[str]  # names of conf/robot
    one: int  # cases with one effect, of each effect and robot
    two: int  # cases with two effects, of each robot
    none: int  # cases with nothing hidden, of each robot
    excluded: int  # cases whose effect is not a candidate, of each robot
    # number of cases to keep, drawn at random but of every kind; None keeps all
    sample: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = {kind: getattr(self, kind) for kind in KINDS}
        wrong = {kind: n for kind, n in counts.items() if n < 0}
        if not self.robots or wrong or not any(counts.values()):
            raise Sim2RealError(
                f"an exam of robots={list(self.robots)} and {counts} has no case; name a robot, "
                "and give a count above 0 and none below"
            )
        if self.sample is not None and self.sample < 1:
            raise Sim2RealError(f"sample={self.sample} must be at least 1, or null for all cases")

    def draw(self, seed: int) -> list[Outline]:
        """Return the cases; the same seed gives the same ones."""
        order = np.random.default_rng([seed, 0])
        wanted = [case for robot in self.robots for case in self._of(robot, order)]
        mixed = _mixed(wanted, order)
        if self.sample is not None:
            mixed = _sampled(mixed, self.sample)
        seeds = np.random.SeedSequence(seed).generate_state(len(mixed))
        return [
            Outline(f"case_{i:03d}", kind, robot, effects, int(seeds[i]))
            for i, (kind, robot, effects) in enumerate(mixed)
        ]

    def _of(self, robot: str, order: np.random.Generator) -> list[Wanted]:
        cases: list[Wanted] = [("one", robot, (effect,)) for effect in EFFECTS] * self.one
        cases += [("two", robot, pair) for pair in _pairs(self.two, order)]
        cases += [("none", robot, ())] * self.none
        return cases + [("excluded", robot, (e,)) for e in evenly(LOCAL, self.excluded, order)]

    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Record a case; see `Examiner`.

        Two effects, or one to be removed, that a robot cannot show are drawn again, so that there
        are as many of these cases as were asked for; what each single effect was asked stays so.
        """
        tries = (replace(outline, effects=e) for e in (outline.effects, *_others(outline)))
        return any(self._make(one, logs, key) for one in tries)

    def _make(self, outline: Outline, logs: Path, key: Path) -> bool:
        robot = exam_robot(outline.robot, logs)
        hidden = hide(robot, outline.effects, outline.seed)
        if hidden is None or not _record(robot, hidden, outline.seed, logs, key):
            return False
        exclude: tuple[str, ...] = ()
        if outline.kind == "excluded":
            again = read_log(logs / "a_again.csv")
            rivals = withheld(robot, hidden.truths[0], again, hidden.floor, outline.seed)
            exclude = (*outline.effects, *rivals)
        if len(exclude) >= len(EFFECTS):
            return False
        joint_of = {body: joint for joint, body in moved(robot).items()}
        case = Case(
            *(outline.name, outline.kind, outline.robot, outline.seed),
            **hidden._asdict(),
            residue=_residue(robot, outline.seed),
            exclude=exclude,
            joints=tuple(moved(robot)),
            bodies=joint_of,
        )
        write_task(logs, exclude)
        case.write(key)
        return True


def _record(robot: Robot, hidden: Hidden, seed: int, logs: Path, key: Path) -> bool:
    """Record a case's logs and the one that is held back; False if the robot stops on the way."""
    secret = entries(hidden.truths)
    made = plans(robot, seed)
    try:
        recorded = [
            drive(robot, secret, plan, seed + 2 + i) for i, plan in enumerate(made.values())
        ]
    except HardwareError:
        return False
    for name, log in zip(made, recorded, strict=True):
        write_log((key if name == "held" else logs) / f"{name}.csv", log)
    return True


def _residue(robot: Robot, seed: int) -> float:
    """Return the nominal model's error on a robot that hides nothing [rad]."""
    log = drive(robot, [], plans(robot, seed)["held"], seed + 9)
    return overall(apart(log, mujoco.MjSpec.from_file(str(robot.model))))


def evenly(names: Sequence[str], count: int, rng: np.random.Generator) -> list[str]:
    """Return `count` names, each as often as the others to within one."""
    rounds = [rng.permutation(names) for _ in range(-(-count // len(names)))]
    return [str(name) for name in np.concatenate(rounds)[:count]] if rounds else []


def _pairs(count: int, rng: np.random.Generator) -> list[tuple[str, str]]:
    """Return pairs of effects that logs can separate, each effect about equally often."""
    found: list[tuple[str, str]] = []
    while len(found) < count:
        names = [str(name) for name in rng.permutation(list(EFFECTS))]
        pairs = zip(names[::2], names[1::2], strict=False)
        found += [p for p in pairs if not any(set(p) <= family for family in ALIKE)]
    return found[:count]


def _others(outline: Outline) -> Iterator[tuple[str, ...]]:
    """Yield what may be hidden where a robot cannot show a case's effects; nothing for one."""
    rng = np.random.default_rng([outline.seed, 3])
    if outline.kind == "two":
        yield from _pairs(REDRAWS, rng)
    elif outline.kind == "excluded":
        yield from ((effect,) for effect in evenly(LOCAL, REDRAWS, rng))


def _mixed(cases: list[Wanted], rng: np.random.Generator) -> list[Wanted]:
    """Return all cases in an order whose every part has kinds and robots in their proportion.

    So an exam that is stopped anywhere was held on each of them.
    """
    shuffled = [cases[i] for i in rng.permutation(len(cases))]
    groups: dict[tuple[str, str], list[Wanted]] = {}
    for case in shuffled:
        groups.setdefault(case[:2], []).append(case)
    placed = [
        ((number + shift) / len(group), case)
        for group, shift in zip(groups.values(), rng.uniform(size=len(groups)), strict=True)
        for number, case in enumerate(group)
    ]
    return [case for _, case in sorted(placed, key=lambda one: one[0])]


def _sampled(cases: list[Wanted], count: int) -> list[Wanted]:
    """Return `count` of the shuffled cases, in their order, kinds in their proportion.

    No kind is left out as long as there is room for one case of each.
    """
    groups = sorted(([c for c in cases if c[0] == kind] for kind in KINDS), key=len)
    kept: list[int] = []
    for number, group in enumerate(group for group in groups if group):
        room = count - len(kept) - sum(bool(g) for g in groups) + number + 1
        share = max(round(count * len(group) / len(cases)), 1)
        places = [i for i, case in enumerate(cases) if case[0] == group[0][0]]
        kept += places[: min(share, max(room, 0))]
    return [cases[i] for i in sorted(kept)]
