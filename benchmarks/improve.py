"""How much of a policy's lost return does `improve` win back on a robot that hides something?

    python -m benchmarks.improve                       # 12 loops: hours; goes on where it stopped
    python -m benchmarks.improve --robots hopper2 --seeds 0
    python -m benchmarks.improve --most 0              # the table of what is done so far

A policy is trained in the simulator as given, once a robot and seed. On each of three robots that
hide something (`conf/shift/`) `run=improve` has three rounds, without a person. The best that it
could do is a policy that is trained on from the same one, for as many iterations, in the simulator
with what is hidden. The gap that is closed is (improved - as given) / (best - as given), returns on
the emulated robot. A robot that costs the policy less than the noise has no gap, and is listed and
not counted.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Any

from benchmarks import study
from benchmarks.cases import over_runs
from benchmarks.study import at_least, command
from sim2real.config.compose import compose, instantiate
from sim2real.deployment.record import configure_robot
from sim2real.deployment.stops import make_stop_limits
from sim2real.deployment.trained import load_trained
from sim2real.loops.improve.operator import Operator
from sim2real.loops.improve.site import RobotSetup
from sim2real.loops.improve.steps import learn
from sim2real.loops.improve.story import RESULT
from sim2real.runs.checkpoint import FOLDER, find, read_metadata
from sim2real.runs.files import folder_lock, write_text
from sim2real.runs.statistics import Interval, iqm
from sim2real.runs.tables import Table

SHIFTS = Path(__file__).parents[1] / "conf" / "shift"
WORLDS = {
    "hopper2": ("hopper2_mass", "hopper2_soft", "hopper2_slow"),
    "quad8": ("quad8_side_mass", "quad8_soft", "quad8_slow"),
}
ITERATIONS = {"hopper2": 30, "quad8": 20}  # that each round adds
STOPS = "stops={odd_voltage: 1.0, stray: 2.0}"  # a hidden effect must not stop the robot
SHORT = ("rounds=3", "trials=10", "rollouts=16", STOPS)
ASKED = 0.7  # of the gap, that is to be closed


@dataclass(frozen=True)
class Case:
    """A policy on a robot that hides something."""

    robot: str
    world: str  # what it hides, of conf/shift
    seed: int  # of the policy's training and of the loop
    out: Path  # the folder of all cases

    @property
    def policy(self) -> Path:
        """The run that trained the policy as given."""
        return self.out / "policies" / self.robot / f"seed{self.seed}"

    @property
    def folder(self) -> Path:
        """Of its loop."""
        return self.out / self.world / f"seed{self.seed}"

    @property
    def result(self) -> Path:
        """What came of it."""
        return self.folder / "case.json"

    @property
    def line(self) -> list[str]:
        """The command's keys."""
        hidden = SHIFTS / f"{self.world}.yaml"
        own = [f"robot={self.robot}", f"robot.hidden={hidden}", f"seed={self.seed}"]
        more = f"iterations={ITERATIONS[self.robot]}"
        return ["run=improve", f"checkpoint={self.policy}", *own, *SHORT, more]


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, run what is left and keep the table; return the exit status."""
    parser = command("improve", __doc__, "out", "results")
    add = parser.add_argument
    add("--robots", nargs="+", choices=list(WORLDS), default=list(WORLDS), help="default: both")
    add("--seeds", type=at_least(0), nargs="+", default=[0, 1], help="default: 0 and 1")
    add("--most", type=at_least(0), help="loops to run now; 0 writes the table only")
    chosen = parser.parse_args(arguments)
    every = cases(chosen.robots, chosen.seeds, chosen.out)
    left = [case for case in every if not case.result.is_file()]
    failed = 0
    for case in left[: chosen.most]:
        with folder_lock(case.folder) as mine:
            failed += mine and not case.result.is_file() and not run(case)
        report(every, chosen.results)
    if report(every, chosen.results) is None:
        print("no loop is complete so far", file=sys.stderr)
        return 1
    return int(failed > 0)


def cases(robots: Sequence[str], seeds: Sequence[int], out: Path) -> list[Case]:
    """Return all cases, one seed after the other."""
    return [
        Case(robot, world, seed, out)
        for seed, robot in product(seeds, robots)
        for world in WORLDS[robot]
    ]


def run(case: Case) -> bool:
    """Train, improve and compare; return whether that came to its end."""
    with folder_lock(case.policy) as mine:
        if not mine or not trained(case):
            return False
    case.folder.mkdir(parents=True, exist_ok=True)
    where = (f"hydra.run.dir={case.folder}", f"resume={case.folder}")
    done = study.sim2real(*case.line, *where)
    told = read(case.folder / RESULT)
    if not done and told.get("end") != "stopped":
        return False
    content = {"robot": case.robot, "world": case.world, "seed": case.seed, **told}
    write_text(case.result, json.dumps({**content, "best_possible": best(case, told)}) + "\n")
    return True


def trained(case: Case) -> bool:
    """Train the policy as given, unless that is done."""
    begun = any((case.policy / FOLDER).glob("checkpoint-*"))
    keys = [f"seed={case.seed}", "eval=none", "video=none", f"hydra.run.dir={case.policy}"]
    again = [f"resume={case.policy}"] if begun else []
    if begun and (case.policy / "trained").is_file():
        return True
    done = study.sim2real(f"+experiment={case.robot}_es", *keys, *again)
    if done:
        (case.policy / "trained").touch()
    return done


def best(case: Case, told: dict[str, Any]) -> list[float]:
    """Return what a policy earns on the robot that was trained on with what is hidden.

    It goes on from the policy as given, for as many iterations as the loop's best one did.
    """
    _, given = instantiate(compose(case.line), case.folder)
    parts, algorithm = given["parts"], given["algorithm"]
    first = load_trained(case.policy, parts, algorithm)
    machine = configure_robot(given["robot"], None, None)
    done = read_metadata(find(case.policy))["iteration"]
    rounds = max(len(told["rounds"]) - 1, 1)
    settings = {
        "algorithm": algorithm,
        "iterations": done + rounds * given["iterations"],
        "frames": None,
        **{key: given[key] for key in ("logger", "checkpoint_every", "keep_checkpoints")},
    }
    corrected = parts.with_effects(machine.hidden)
    policy = learn(case.folder, "truth", corrected, settings, start=first.source)
    site = RobotSetup(
        machine,
        parts.environment,
        Operator(),
        given["trials"],
        given["settle"],
        make_stop_limits(given["stops"]),
        True,
        given["motions"],
        given["seconds"],
        case.seed,
    )
    return site.deploy(policy, case.folder / "truth_on_robot")


def read(path: Path) -> dict[str, Any]:
    """Return a JSON file; {} where there is none."""
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def report(every: Sequence[Case], results: Path) -> Table | None:
    """Write improve.md and improve.csv of what is done; None where nothing is."""
    done = [read(case.result) for case in every if case.result.is_file()]
    if not done:
        return None
    made = table(done, complete=len(done) == len(every))
    if len(done) < len(every):
        missing = len(every) - len(done)
        made.notes.append(f"PARTIAL: {missing} of {len(every)} loops are missing.")
    made.notes.append("Made by `python -m benchmarks.improve`.")
    made.write(results / "improve", "A policy's lost return, won back in at most three rounds")
    print(made.markdown())
    return made


def table(done: Sequence[dict[str, Any]], complete: bool) -> Table:
    """Return a row for each loop, and the interquartile mean of what they closed.

    Whether that is what was asked for is said of all loops only.
    """
    columns = ("hidden", "seed", "in the simulator", "as given", "improved", "best possible")
    made = Table((*columns, "rounds", "gap closed", "found", "ended because"))
    shares = []
    for one in done:
        share = closed(one)
        shares += [] if share is None else [share]
        rounds, last = one["rounds"], one["rounds"][-1]
        returns = [fmean(rounds[0]["simulator"]), fmean(rounds[0]["robot"]), improved(one)]
        found = ", ".join(f"{c['label']} {c['value']:.3g}" for c in last["causes"]) or "–"
        ends = (len(rounds) - 1, share, found, one["words"])
        made.add(one["world"], str(one["seed"]), *returns, fmean(one["best_possible"]), *ends)
    made.notes.append(
        f"Returns: means of {len(done[0]['best_possible'])} episodes on the emulated robot, in the "
        "simulator as given for the first. Gap closed = (improved - as given) / (best possible "
        "- as given); best possible: trained on with what is hidden, for as many iterations."
    )
    if len(shares) > 1:
        whole = over_runs(shares, iqm)
        assert isinstance(whole, Interval)
        answer = "reached" if whole.value >= ASKED else "missed"
        answer = answer if complete else "open until all loops are done"
        made.notes.append(
            f"Gap closed, interquartile mean over {len(shares)} loops with a gap: "
            f"{whole.value:.2f} [{whole.low:.2f}, {whole.high:.2f}] (95 %, bootstrap over loops); "
            f"asked for: {ASKED}, {answer}."
        )
    return made


def improved(one: dict[str, Any]) -> float:
    """Return what the best policy of a loop earns on the robot."""
    return fmean(one["rounds"][one["best"]]["robot"])


def closed(one: dict[str, Any]) -> float | None:
    """Return the share of a loop's gap that it closed; None where there was none to close."""
    before, most = fmean(one["rounds"][0]["robot"]), fmean(one["best_possible"])
    if (len(one["rounds"]) == 1 and one["end"] == "within_noise") or most <= before:
        return None
    return (improved(one) - before) / (most - before)


if __name__ == "__main__":
    raise SystemExit(main())
