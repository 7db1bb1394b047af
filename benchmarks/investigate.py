"""Does a designed recording part causes sooner than the menu's motions, one after the other?

    python -m benchmarks.investigate                    # 20 robots: hours; goes on where it stopped
    python -m benchmarks.investigate --robots 4 --seed 11
    python -m benchmarks.investigate --most 0           # the table of what is done so far

An emulated robot hides one effect; its first log is a short and slow one. Where that leaves several
explanations open, `run=investigate` goes on from it within its budget, and so does a baseline that
records the menu's motions in their order until one explanation is left. Where the investigation
says that no motion parts them, 200 drawn motions are asked: it was wrong if one of them parts any
two of what is left by three noise floors after refits. Robots whose first log leaves nothing open
are drawn again and counted.
"""

import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.study import at_least, command
from envs.effects import load_effects
from envs.errors import EnvsError
from hardware.config import Robot, load_robot
from hardware.errors import HardwareError
from hardware.log import Log, read_log
from sim2real.deployment.record import record_motions
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.experiments.menu import Item, menu
from sim2real.diagnosis.experiments.next_experiment import next_experiment
from sim2real.diagnosis.settings import DEFAULT
from sim2real.exam.hiding import EFFECTS
from sim2real.exam.logs import exam_robot
from sim2real.exam.score import wilson
from sim2real.exam.sizes import entries, hide
from sim2real.loops.investigate import Investigation, SearchBudget, investigate
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import folder_lock, write_text
from sim2real.runs.tables import Table

ROBOTS = ("bench1", "arm2")
FIRST = Item("slow ramps", ("ramp",), 6.0, 0.3)
BUDGET = 62.0  # s: the first log and as long as the menu's seven motions without a hand
ASKED = 200  # drawn motions that may prove "no motion parts them" wrong
TRIES = 12  # draws for each robot whose first log is to leave something open


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, investigate what is left of the robots and keep the table."""
    parser = command("investigate", __doc__, "out", "results")
    add = parser.add_argument
    add("--robots", type=at_least(1), default=20, help="in all (default: %(default)s)")
    add("--seed", type=int, default=11, help="of their draw (default: %(default)s)")
    add("--most", type=at_least(0), help="robots to do now; 0 writes the table only")
    chosen = parser.parse_args(arguments)
    files = [chosen.out / f"{chosen.seed}_{number:03d}.json" for number in range(chosen.robots)]
    left = [number for number, file in enumerate(files) if not file.is_file()]
    for number in left[: chosen.most]:
        with folder_lock(chosen.out / "claims" / files[number].stem) as mine:
            if mine and not files[number].is_file():
                told = one_robot(chosen.seed, number)
                write_text(files[number], json.dumps(told, indent=1) + "\n")
    done = [json.loads(f.read_text(encoding="utf-8")) for f in files if f.is_file()]
    if not done:
        print("no robot was investigated so far", file=sys.stderr)
        return 1
    made = table(done)
    made.notes.append(f"Seed {chosen.seed}; {len(done)} robots of {chosen.robots} drawn.")
    made.write(chosen.results / "investigate")
    print(made.markdown())
    return 0


def one_robot(seed: int, number: int) -> dict[str, Any]:
    """Draw robots until the first log of one leaves something open, and part that both ways."""
    rng = np.random.default_rng([seed, number])
    for attempt in range(TRIES):
        name, effect = ROBOTS[number % len(ROBOTS)], str(rng.choice(list(EFFECTS)))
        with tempfile.TemporaryDirectory() as folder:
            try:
                told = _parted(name, effect, int(rng.integers(2**31)), Path(folder))
            except (Sim2RealError, HardwareError, EnvsError) as error:  # it cannot show this effect
                print(f"{name} with {effect}: {error}", file=sys.stderr)
                continue
        if told is not None:
            return {"robot": name, "effect": effect, "redrawn": attempt, **told}
    return {"robot": ROBOTS[number % len(ROBOTS)], "redrawn": TRIES}


def _parted(name: str, effect: str, seed: int, folder: Path) -> dict[str, Any] | None:
    """Return how both ways went; None where the first log leaves nothing open."""
    hidden = hide(exam_robot(name, folder), (effect,), seed)
    if hidden is None:
        return None
    path = folder / "hidden.yaml"
    write_text(path, json.dumps(entries(hidden.truths)))
    load_effects(path)
    robot = replace(load_robot(name), hidden=path)
    record = recorder(robot)
    first = record(FIRST, folder / "first.csv")
    if not run_diagnosis([first], None, None, (), 0, None).equivalents:
        return None
    out = folder / "designed"
    limits = SearchBudget(BUDGET - FIRST.seconds)
    found = investigate(robot, record, limits, FIRST, seed=seed, out=out, logs=[first])
    told = {
        "end": found.end,
        "seconds": found.seconds,
        "named": _names(found, effect),
        "left": len(found.rounds[-1].left),
        "menu": _by_menu(robot, record, first, folder),
    }
    if found.end == "not_parted":
        told["asked"] = _asked(robot, out, first, seed)
    return told


def recorder(robot: Robot) -> Callable[[Item, Path], Log]:
    """Return what drives a robot along a motion."""

    def record(item: Item, path: Path) -> Log:
        rng = np.random.default_rng(item.seed)
        record_motions(robot, item.motions, item.seconds, rng, path, item.size)
        return read_log(path)

    return record


def _names(found: Investigation, effect: str) -> bool:
    """Return whether the hidden effect is a cause, or stands in a cause's equivalents."""
    return any(
        effect in (cause.effect, *(other.effect for other in cause.equivalent))
        for cause in found.report.causes
    )


def _by_menu(
    robot: Robot, record: Callable[[Item, Path], Log], first: Log, folder: Path
) -> dict[str, Any]:
    """Record the menu in its order until one explanation is left; return how long that took."""
    spec = mujoco.MjSpec.from_file(str(robot.model))
    logs, seconds = [first], 0.0
    for number, item in enumerate(one for one in menu(spec) if one.change is None):
        logs.append(record(item, folder / f"menu_{number}.csv"))
        seconds += item.seconds
        found = run_diagnosis(logs, None, None, (), 0, None)
        if not found.equivalents:
            return {"seconds": seconds, "left": 0, "causes": len(found.report.causes)}
    return {"seconds": seconds, "left": len(found.equivalents), "causes": len(found.report.causes)}


def _asked(robot: Robot, out: Path, first: Log, seed: int) -> float:
    """Return by how many floors many drawn motions part any two of what is left at most."""
    logs = [first, *(read_log(path) for path in sorted((out / "recordings").glob("*.csv")))]
    found = run_diagnosis(logs, None, None, (), seed, None)
    if not found.equivalents:
        return 0.0
    plan = next_experiment(
        found.equivalents,
        mujoco.MjSpec.from_file(str(robot.model)),
        found.floors,
        rng=np.random.default_rng([seed, ASKED]),
        robot=robot,
        draws=ASKED,
        exact=1,
        by_hand=False,
    )
    return plan.most


def table(done: Sequence[dict[str, Any]]) -> Table:
    """Return what both ways did, with 95 % intervals."""
    told = [one for one in done if "end" in one]
    ends = [one["end"] for one in told]
    wrong = [one.get("asked", 0.0) >= DEFAULT.experiment.apart_min for one in told]
    parted = [end == "one_left" for end in ends]
    right = [
        one or (end == "not_parted" and not bad)
        for one, end, bad in zip(parted, ends, wrong, strict=True)
    ]
    by_menu = [one["menu"]["left"] == 0 for one in told]
    both = [one for one, a, b in zip(told, parted, by_menu, strict=True) if a and b]
    mine, menus = sum(o["seconds"] for o in both), sum(o["menu"]["seconds"] for o in both)
    none = [
        (one, menu)
        for one, end, menu in zip(told, ends, by_menu, strict=True)
        if end == "not_parted"
    ]
    made = Table(("what", "designed", "menu in its order"))
    made.add("one explanation is left", wilson(parted), wilson(by_menu))
    made.add("one is left, or rightly none can be parted", wilson(right), None)
    made.add("the hidden effect is named", wilson([one["named"] for one in told]), None)
    made.add(f"robot time of the {len(both)} that both parted, s", mine, menus)
    redrawn = sum(one["redrawn"] for one in done)
    made.notes.append(
        f"{len(told)} robots whose first log left several explanations open ({redrawn} draws left "
        f"none, or the robot could not show the effect); ends: "
        f"{', '.join(f'{end} {ends.count(end)}' for end in sorted(set(ends)))}; a drawn motion "
        f"proved 'no motion parts them' wrong {sum(wrong)} times."
    )
    if none:
        furthest, menus_parted = max(one["asked"] for one, _ in none), sum(menu for _, menu in none)
        made.notes.append(
            f"Where no motion parted them, drawn ones parted any two by {furthest:.1g} floors at "
            f"most; in {menus_parted} of these {len(none)} the menu's logs left one explanation."
        )
    return made


if __name__ == "__main__":
    sys.exit(main())
