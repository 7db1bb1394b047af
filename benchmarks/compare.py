"""Does `run=compare` see a robot change, and keep quiet where it did not?

    python -m benchmarks.compare --pairs 100             # half unchanged; goes on where it stopped
    python -m benchmarks.compare --pairs 24 --seed 61 --kinds zero --seconds 120

An emulated arm2 with friction of its own is recorded twice along the same motion, as a cron job
would. The noise is other, and it is up to 10 K warmer or colder: friction falls by 1 % a kelvin,
strength by 0.4 %, and the servos say how warm they are. Unless `bolted` is in the table it was
mounted anew, too (a tilt of 0.3 degrees, standard deviation, about two axes). In every second pair
something else changed: 15 % more friction at one joint, 0.5 degrees of one joint's zero (bolted: to
a hanging arm a zero and a tilt are nearly the same), or a supply of 90 %, which the servos measure.
`compare` is given the two logs, the nominal model, and whether the arm was bolted. A change is
named if it is reported first, or as an equivalent of what is; intervals are exact binomial ones.
A row a pair in `compare.csv`; a pair that is there is not made again.
"""

import argparse
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from benchmarks.cases import Cases, share, typed
from benchmarks.study import at_least, command
from hardware.config import Robot
from hardware.excite import excite
from hardware.log import Log
from hardware.stand import home_pose
from sim2real.diagnosis.comparison.answer import Comparison
from sim2real.diagnosis.comparison.compare import compare
from sim2real.exam.logs import drive, exam_robot, motions
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

ROBOT, SIZE = "arm2", 0.5
SECONDS = 24.0  # of a recording
KINDS = ("friction", "zero", "supply")
FRICTION = (0.03, 0.07)  # of the stall torque, before
TILT = np.radians(0.3)  # rad, standard deviation
WARMER = 10.0  # K
FRICTION_PER_K, STRENGTH_PER_K = -0.01, -0.004
MORE_FRICTION, ZERO, SUPPLY = 0.15, np.radians(0.5), 0.9
EFFECTS = {"friction": "coulomb_friction", "zero": "encoder_offset", "supply": "supply_voltage"}
Entries = list[dict[str, Any]]


class Pair(NamedTuple):
    """Two recordings, and what changed between them."""

    kind: str  # "unchanged" or of KINDS
    joint: str | None
    bolted: bool
    before: Log
    after: Log


class Row(NamedTuple):
    """What was said of a pair."""

    pair: str  # seed and number
    kind: str
    joint: str
    bolted: int
    verdict: str
    named: str
    right: int
    more: int  # changes named beside the right one
    seconds: str  # of processor time


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, make and compare the pairs, and keep the table."""
    parser = command("compare", __doc__, "results")
    parser.add_argument("--pairs", type=at_least(2), default=24, help="half of them unchanged")
    parser.add_argument("--seed", type=int, default=14)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of change")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of a recording")
    given = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if given.seconds <= 0:
        parser.error("--seconds must be above 0")
    cases = Cases(given.results / "compare.csv", Row._fields, "pair")
    with TemporaryDirectory() as folder:
        robot = exam_robot(ROBOT, Path(folder))

        def judged(number: int) -> list[dict[str, Any]]:
            return [judge(number, robot, given.seed, given.seconds, given.kinds)._asdict()]

        rows = cases.run(given.seed, given.pairs, judged)
    keep(typed(Row, rows), given)
    return 0


def judge(
    number: int, robot: Robot, seed: int, seconds: float, kinds: Sequence[str] = KINDS
) -> Row:
    """Make a pair and compare it."""
    kind = kinds[number // 2 % len(kinds)] if number % 2 else "unchanged"
    bolted = kind == "zero" or number % 4 == 2
    pair = make(kind, robot, np.random.default_rng([seed, number]), seconds, bolted)
    start = sum(os.times()[:4])
    answer = compare(pair.before, pair.after, robot.model, seed=number, remounted=not bolted)
    spent = sum(os.times()[:4]) - start
    right = is_named(answer, pair)
    more = len(answer.changes) - (kind != "unchanged" and right)
    changes = [f"{c.effect} at {c.where or 'the robot'} {c.change:+.3g}" for c in answer.changes]
    what = (kind, pair.joint or "", int(bolted), answer.verdict, "; ".join(changes))
    return Row(f"{seed}-{number}", *what, int(right), more, f"{spent:.1f}")


def make(kind: str, robot: Robot, rng: np.random.Generator, seconds: float, bolted: bool) -> Pair:
    """Record a robot twice along one motion, with what a kind of change does in between."""
    joints = list(robot.names)
    stall = robot.servos[0].type.stall_torque(robot.supply.voltage)
    friction = rng.uniform(*FRICTION, len(joints)) * stall
    joint = str(rng.choice(joints)) if kind in ("friction", "zero") else None
    plan = excite(robot, home_pose(robot), seconds, motions(robot), rng, SIZE)
    warmer = float(rng.uniform(-WARMER, WARMER))
    more = np.array([MORE_FRICTION * (kind == "friction" and name == joint) for name in joints])
    tilts = rng.normal(0, TILT, (2, 2))
    tilts[1] = tilts[0] if bolted else tilts[1]
    first = hidden(joints, friction, tilts[0])
    second = hidden(joints, friction * (1 + more) * (1 + FRICTION_PER_K * warmer), tilts[1])
    second.append({"effect": "motor_strength", "where": None, "value": 1 + STRENGTH_PER_K * warmer})
    if kind == "zero":
        sign = float(rng.choice([-1.0, 1.0]))
        second.append({"effect": "encoder_offset", "where": joint, "value": sign * ZERO})
    if kind == "supply":
        second.append({"effect": "supply_voltage", "where": None, "value": SUPPLY})
    before, after = (
        drive(robot, entries, plan, int(rng.integers(2**31))) for entries in (first, second)
    )
    warm = {
        name: values + warmer if name.startswith("temperature.") else values
        for name, values in after.columns.items()
    }
    return Pair(kind, joint, bolted, before, Log(warm, after.meta, after.path))


def hidden(joints: Sequence[str], friction: np.ndarray, tilt: np.ndarray) -> Entries:
    """Return what the emulated robot has: friction at each joint, and a mounting."""
    entries: Entries = [
        {"effect": "coulomb_friction", "where": name, "value": float(value)}
        for name, value in zip(joints, friction, strict=True)
    ]
    return [*entries, {"effect": "gravity_tilt", "where": None, "value": tilt.tolist()}]


def is_named(answer: Comparison, pair: Pair) -> bool:
    """Return whether an answer is right."""
    if pair.kind == "unchanged":
        return answer.verdict != "changed"
    if not answer.changes:
        return False
    first = answer.changes[0]
    names = [(one.effect, one.where) for one in (first, *first.alike)]
    return (EFFECTS[pair.kind], pair.joint) in names


def keep(own: Sequence[Row], given: argparse.Namespace) -> None:
    """Write compare.md, a row for each kind of a seed's pairs."""
    groups: dict[str, list[Row]] = {}
    for row in own:
        kind = f"{row.kind} of the {row.joint}" if row.kind == "zero" else row.kind
        groups.setdefault(kind + (", bolted" if row.bolted else ""), []).append(row)
    table = Table(("what changed", "pairs", "called changed", "right"))
    for kind, some in sorted(groups.items(), key=lambda item: "unchanged" not in item[0]):
        _add(table, kind, some)
    _add(table, "all unchanged", [row for row in own if row.kind == "unchanged"])
    _add(table, "all changed", [row for row in own if row.kind != "unchanged"])
    more = "" if list(given.kinds) == list(KINDS) else f" --kinds {' '.join(given.kinds)}"
    more += "" if given.seconds == SECONDS else f" --seconds {given.seconds:g}"
    table.notes.append(
        f"`python -m benchmarks.compare --pairs {len(own)} --seed {given.seed}{more}`: an emulated "
        f"{ROBOT}, recorded twice for {given.seconds:g} s along one motion; in between it became "
        "warmer or colder, and was mounted anew unless bolted. Right: an unchanged pair is not "
        "called changed; of a changed one the change is named first, or as an equivalent of what "
        "is. Exact 95 % intervals."
    )
    spent = np.array([float(row.seconds) for row in own])
    table.notes.append(
        f"{sum(row.more for row in own)} further changes are named that were not made. A "
        f"comparison takes {np.median(spent):.0f} s of processor time in the median."
    )
    write_text(given.results / "compare.md", table.markdown())


def _add(table: Table, kind: str, rows: Sequence[Row]) -> None:
    if not rows:
        return
    changed = sum(row.verdict == "changed" for row in rows)
    table.add(kind, len(rows), changed, share([row.right for row in rows]))


if __name__ == "__main__":
    raise SystemExit(main())
