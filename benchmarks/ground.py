"""Does a diagnosis name what is hidden in walks whose base nobody measured?

    python -m benchmarks.ground --cases 12              # sealed draws of seed 5, resumable
    python -m benchmarks.ground --cases 40 --seed 8 --robot quad12
    python -m benchmarks.ground --cases 12 --seed 40 --engine drake
    python -m benchmarks.ground --development           # the walks that it was developed on

The emulated robot (servo emulator, bus, another time step than the model's) walks with drawn
offsets and hides one effect, or none. Its logs hold encoders and the IMU where it has one, never
the base's position; half of the episodes begin in mid-gait. The diagnosis gets logs and model; the
key is opened afterwards. Then a policy of linear feedback walks on the same robot, and in the
simulator with what was found (`benchmarks.ground_loop`). A row a case in `ground.csv`; a case that
is there is not run again.
"""

import logging
import os
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.cases import Cases
from benchmarks.ground_loop import loop
from benchmarks.ground_walks import SECONDS, WALKERS, Entry, walks, walks_elsewhere
from benchmarks.study import at_least, command
from hardware.config import Robot, load_robot
from sim2real.diagnosis.closed_loop.check import Drawn
from sim2real.diagnosis.diagnose import diagnose, run_diagnosis
from sim2real.diagnosis.schema import Cause, ClosedLoop, Estimate, Report

DEVELOPED = 11  # seed of the walks that it was developed on
FIELDS: tuple[str, ...] = ("case", "robot", "hidden", "where", "value", "verdict", "named")
FIELDS += (
    "place",
    "right",
    "explained_wrong",
    "superfluous",
    "found",
    "closed",
    "seconds",
    "cpu_seconds",
)
FIELDS += ("loop", "floor", "nominal", "corrected", "return", "return_nominal", "return_corrected")
FIELDS += ("engine",)
EMULATOR = "emulator"


def drawn(robot: Robot, rng: np.random.Generator) -> list[Entry]:
    """Draw what a case hides: one effect at a place, or nothing."""
    joints, walker = list(robot.names), WALKERS[robot.name]
    place = str(rng.choice(joints))
    menu: list[list[Entry]] = [
        [],
        [{"effect": "coulomb_friction", "where": place, "value": rng.uniform(*walker.dry)}],
        [{"effect": "motor_strength", "where": place, "value": rng.uniform(0.5, 0.8)}],
        [{"effect": "command_delay", "where": None, "value": rng.uniform(0.01, 0.03)}],
        [{"effect": "ground_friction", "where": None, "value": rng.uniform(0.15, 0.35)}],
        [{"effect": walker.load, "where": walker.torso, "value": rng.uniform(*walker.loads)}],
        [{"effect": "viscous_friction", "where": place, "value": rng.uniform(*walker.wet)}],
    ]
    if walker.feels:
        menu += [[entry] for entry in _of_the_imu(rng)]
    return menu[int(rng.integers(len(menu)))]


def _of_the_imu(rng: np.random.Generator) -> list[Entry]:
    """Draw a fault of each kind of an IMU: its mounting [rad], delay [s], and gyro [rad/s]."""
    side = rng.uniform(0, 2 * np.pi)
    askew = rng.uniform(0.05, 0.1) * np.array([np.cos(side), np.sin(side), 0.0])
    bias = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.4) * np.eye(3)[rng.integers(3)]
    values = {"imu_mounting": askew.tolist(), "imu_delay": rng.uniform(0.01, 0.03)}
    values["gyro_bias"] = bias.tolist()
    return [{"effect": name, "where": None, "value": value} for name, value in values.items()]


def case(seed: int, number: int, name: str = "quad8", engine: str = EMULATOR) -> dict[str, Any]:
    """Make a case of a robot, diagnose it, then open its key; return its row.

    In another engine no policy walks: what its row tells of a loop is empty.
    """
    rng = np.random.default_rng([seed, number])
    key, own, logs = [], 0, []
    while not logs:  # a robot that cannot stand up is drawn again
        key, own = drawn(load_robot(name), rng), int(rng.integers(1 << 31))
        logs = (walks if engine == EMULATOR else walks_elsewhere)(name, key, own)
    start, before = time.monotonic(), sum(os.times()[:4])
    found = run_diagnosis(logs, None, None, (), 0, None)
    row = {"case": f"{seed}-{number}", "robot": name, "engine": engine}
    row |= scored(found.report, key)
    row["seconds"] = f"{time.monotonic() - start:.0f}"
    row["cpu_seconds"] = f"{sum(os.times()[:4]) - before:.0f}"
    if engine != EMULATOR:
        return row
    drawn_ = zip(found.found, found.intervals, strict=True)
    effects = [Drawn(effect, tuple(values), ci) for (effect, values), ci in drawn_]
    task = WALKERS[name].task(seconds=SECONDS)
    return row | _told_loop(loop(name, task, key, effects, own))


def _told_loop(one: ClosedLoop) -> dict[str, Any]:
    """Return what of a row is told from the policy in the corrected simulator."""
    first, paid = one.distances[0], one.returns
    row: dict[str, Any] = {"loop": one.verdict}
    row |= {n: _number(getattr(first, n)) for n in ("floor", "nominal", "corrected")}
    if paid is not None:
        row["return"] = _number(paid.robot)
        row["return_nominal"] = _number(paid.nominal)
        row["return_corrected"] = _number(paid.corrected or paid.nominal)
    return row


def _number(one: Estimate | None) -> str:
    return "" if one is None else f"{one.value:.3g}"


def scored(report: Report, key: Sequence[Entry]) -> dict[str, Any]:
    """Return what of a row is told from a report and its key."""
    hidden = key[0] if key else {"effect": "nothing", "where": None, "value": 0.0}
    told = [_matches(cause, hidden) for cause in report.causes]
    right = any(effect and place for effect, place in told[:1])
    if hidden["effect"].startswith("gyro"):  # named before the search, against the orientation
        gyro = [f for f in report.preflight if f.check == "imu" and "gyro" in str(f.where)]
        right = right or bool(gyro and not report.causes)
    if not key:
        right = report.verdict == "no_gap"
    return {
        "hidden": hidden["effect"],
        "where": hidden["where"] or "robot",
        "value": " ".join(f"{x:.3g}" for x in np.atleast_1d(hidden["value"]) + 0.0),
        "verdict": report.verdict,
        "named": int(bool(told) and told[0][0]),
        "place": int(bool(told) and told[0][1]),
        "right": int(right),
        "explained_wrong": int(report.verdict == "explained" and not right),
        "superfluous": sum(not (effect and place) for effect, place in told),
        "found": "; ".join(
            f"{c.effect} {c.where or 'robot'} {c.value:.3g} [{c.value_ci[0]:.3g}, "
            f"{c.value_ci[1]:.3g}]"
            for c in report.values
        ),
        "closed": "" if report.gap.closed is None else f"{report.gap.closed:.2f}",
    }


NO_FRICTION = ("coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction")
NO_FRICTION += ("load_dependent_friction", "hysteretic_compliance", "dead_zone", "backlash")
KNEE: Entry = {"effect": "coulomb_friction", "where": "knee_fl", "value": 0.15}
ICE: Entry = {"effect": "ground_friction", "where": None, "value": 0.3}
DEVELOPMENT: list[tuple[list[Entry], tuple[str, ...]]] = [  # what is hidden, and excluded
    ([], ()),
    ([KNEE], ()),
    ([{"effect": "command_delay", "where": None, "value": 0.02}], ()),
    ([{"effect": "motor_strength", "where": "knee_br", "value": 0.7}], ()),
    ([{"effect": "payload", "where": "torso", "value": 0.25}], ()),
    ([ICE], ()),
    ([ICE], ("ground_friction",)),
    ([{"effect": "imu_mounting", "where": None, "value": [0.05, -0.04, 0.0]}], ()),
    ([{"effect": "imu_delay", "where": None, "value": 0.02}], ()),
    ([KNEE], NO_FRICTION),
]


def develop(name: str = "quad8") -> None:
    """Print a row for each walk that the ground mode was developed on, of a robot."""
    for key, exclude in DEVELOPMENT:
        logs, before = walks(name, key, DEVELOPED), sum(os.times()[:4])
        report = diagnose(logs, exclude=exclude)
        row = scored(report, key)
        spent = sum(os.times()[:4]) - before
        told = (row["hidden"], row["where"], row["value"], ",".join(exclude), row["verdict"])
        print(*told, row["found"], row["closed"], f"{spent:.0f} s", sep=" | ", flush=True)


def _matches(cause: Cause, hidden: Entry) -> tuple[bool, bool]:
    """Return whether a cause, or what cannot be told from it, is the hidden effect; and its place.

    A motor's strength is its gain and its limit of torque; a body's place is the joint that moves
    it, or the body.
    """
    alike = [(cause.effect, cause.where), *((e.effect, e.where) for e in cause.equivalent)]
    own = [where for effect, where in alike if effect == hidden["effect"]]
    body = cause.extra.get("body", cause.where)
    places = {cause.where, body, *own}
    return bool(own), hidden["where"] in places


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, run the cases that are missing, and tell the score."""
    parser = command("ground", __doc__, "results")
    parser.add_argument("--cases", type=at_least(1), default=12, help="cases in all (default: 12)")
    parser.add_argument("--robot", choices=tuple(WALKERS), default="quad8", help="that walks")
    parser.add_argument(
        "--engine", choices=(EMULATOR, "drake"), default=EMULATOR, help="what moves the robot"
    )
    parser.add_argument("--seed", type=int, default=5, help="of their draw (default: %(default)s)")
    parser.add_argument("--development", action="store_true", help="walks that are known")
    chosen = parser.parse_args(arguments)
    if chosen.development:
        develop(chosen.robot)
        return 0
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cases = Cases(chosen.results / "ground.csv", FIELDS)
    for row in cases.rows:  # those of before there were two engines
        row["engine"] = row.get("engine") or EMULATOR

    def judged(number: int) -> list[dict[str, Any]]:
        return [case(chosen.seed, number, chosen.robot, chosen.engine)]

    same = {"robot": chosen.robot, "engine": chosen.engine}
    print(told(cases.run(chosen.seed, chosen.cases, judged, **same)))
    return 0


def told(rows: Sequence[Mapping[str, str]]) -> str:
    """Return the score of rows in a few lines."""
    hidden = [row for row in rows if row["hidden"] != "nothing"]
    sound = [row for row in rows if row["hidden"] == "nothing"]

    def count(which: Sequence[Mapping[str, str]], field: str) -> int:
        return sum(int(row[field]) for row in which)

    seconds = sorted(float(row["seconds"]) for row in rows)
    pairs = [(float(r["return_corrected"]), float(r["return"])) for r in rows if r.get("return")]
    off = sorted(abs(predicted / paid - 1) for predicted, paid in pairs if paid)
    predicted = f"; predicted returns off by {off[len(off) // 2]:.0%} in the median" if off else ""
    cpu = sorted(float(row["cpu_seconds"]) for row in rows)
    return (
        f"{count(hidden, 'right')} of {len(hidden)} hidden effects first, at their place "
        f"({count(hidden, 'named')} named, {count(hidden, 'place')} at the right place); "
        f"{count(sound, 'right')} of {len(sound)} sound robots without a gap; "
        f"{count(rows, 'explained_wrong')} wrongly explained; "
        f"{count(rows, 'superfluous')} superfluous causes; "
        f"{seconds[len(seconds) // 2]:.0f} s and {cpu[len(cpu) // 2]:.0f} s of processor time "
        f"in the median{predicted}"
    )


if __name__ == "__main__":
    raise SystemExit(main())
