"""Do servo robots learn, does it carry over to the bus, and what do 50 episodes there win back?

    python -m benchmarks.robots                                    # 2 robots, 5 seeds: 2 hours
    python -m benchmarks.robots --robots quad8 --seeds 0 1
    python -m benchmarks.robots --report                           # the tables of what there is

For each robot and seed: evolution strategies in the `servo` and in the `ideal` simulation, ES-MAML
on randomized robots, and PPO; each policy goes to the emulated bus, and the one of ES-MAML also to
two robots that differ from the model, where it adapts. All seeds of one step are the same episodes.

Each run has a folder of its own: what is complete is skipped, what was interrupted is continued.
Several of these programs may run at once and share the work.
"""

import json
import resource
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from benchmarks.cases import read_csv
from benchmarks.robots_report import Figures, write
from benchmarks.study import at_least, command, folder_lock, sim2real, trained
from hardware.errors import HardwareError
from sim2real.config.compose import compose, instantiate
from sim2real.evaluation.transfer import read
from sim2real.runs.checkpoint import find, read_metadata
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

ROBOTS = ("quad8", "hopper2")
TRIALS = 5  # episodes on the bus before, and after adapting
MORE = 20  # iterations of ES-MAML after those of plain evolution strategies
SHIFTS = {  # what differs from the model, by robot
    "quad8": {"load": "quad8_side_mass", "friction": "quad8_low_friction"},
    "hopper2": {"load": "hopper2_mass", "friction": "hopper2_low_friction"},
}
CLIMB = (  # 1 episode of the policy as trained, then 7 rounds of 7: 50 in all
    "adapt=batch",
    "adapt.queries=7",
    "adapt.parallel=7",
    "adapt.sigma=0.1",
)


@dataclass(frozen=True)
class Training:
    """A way to train."""

    name: str  # of it and of its folder
    experiment: str  # the second part of its experiment's name
    overrides: tuple[str, ...] = ()  # of the experiment
    # name of the training that it goes on from for MORE iterations; None starts afresh
    after: str | None = None


ROUNDS = (  # the most telling first
    (
        Training("servo", "es"),
        Training("ideal", "es", ("env.task.fidelity=ideal",)),
        Training("esmaml", "esmaml", after="servo"),
    ),
    (Training("ppo", "ppo"),),
)
TRAININGS = tuple(training for round in ROUNDS for training in round)


@dataclass(frozen=True)
class Plan:
    """What to run and where."""

    robots: Sequence[str]  # their names
    seeds: Sequence[int]  # of training
    out: Path  # folder of the runs
    results: Path  # folder of the tables and the picture
    overrides: Sequence[str] = ()  # further settings of every training

    def folder(self, robot: str, seed: int, name: str) -> Path:
        """Return the folder of a training, or of a policy's time on the bus."""
        return self.out / robot / f"seed{seed}" / name


def run(plan: Plan) -> int:
    """Do all that is not yet done, one seed after the other; write the results after each.

    Returns:
        How many jobs failed; the others went on.
    """
    failed = 0
    for trainings in ROUNDS:
        for robot in plan.robots:
            for seed in plan.seeds:
                failed += sum(follow(plan, robot, seed, training) for training in trainings)
                collect(plan)
    return failed


def follow(plan: Plan, robot: str, seed: int, training: Training) -> int:
    """Train a policy and take it to the bus; return how many jobs failed."""
    with folder_lock(plan.folder(robot, seed, training.name)) as mine:
        if not mine:
            return 0
        if not train(plan, robot, seed, training):
            return 1
        failed = int(not ride(plan, robot, seed, training.name))
        for shift in SHIFTS[robot] if training.name == "esmaml" else ():
            failed += not ride(plan, robot, seed, training.name, shift)
        return failed


def train(plan: Plan, robot: str, seed: int, training: Training) -> bool:
    """Train and evaluate a policy from where it stopped; return whether it came to its end."""
    folder = plan.folder(robot, seed, training.name)
    if any(folder.glob("transfer-*.json")):
        return True
    go_on = source(plan, robot, seed, training)
    if go_on is None:
        return False
    with timed(folder):
        return sim2real(
            f"+experiment={robot}_{training.experiment}",
            f"seed={seed}",
            "video=none",
            "keep_checkpoints=1",
            f"hydra.run.dir={folder}",
            *go_on,
            *training.overrides,
            *plan.overrides,
        )


def source(plan: Plan, robot: str, seed: int, training: Training) -> list[str] | None:
    """Return the overrides that say what a training goes on from; None where that is missing."""
    folder = plan.folder(robot, seed, training.name)
    words = []
    if trained(folder):
        words = [f"resume={folder}"]
    if training.after is not None:
        first = plan.folder(robot, seed, training.after)
        if not any(first.glob("transfer-*.json")):
            return None
        done = int(read_metadata(find(first))["iteration"])
        words = [*(words or [f"resume={first}"]), f"iterations={done + MORE}"]
    return words


@contextmanager
def timed(folder: Path) -> Iterator[None]:
    """Add the processor time of the jobs that run meanwhile to a training's, whatever ends them."""
    before = cpu()
    try:
        yield
    finally:
        spent = cpu_minutes(folder) + (cpu() - before) / 60
        write_text(folder / "cpu.json", json.dumps({"minutes": spent}) + "\n")


def cpu() -> float:
    """Return the processor time of the jobs so far [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def cpu_minutes(folder: Path) -> float:
    """Return the processor time that a training has taken [min]."""
    file = folder / "cpu.json"
    return float(json.loads(file.read_text("utf-8"))["minutes"]) if file.is_file() else 0.0


def ride(plan: Plan, robot: str, seed: int, name: str, shift: str | None = None) -> bool:
    """Run a policy on the emulated bus, as it is or, where the robot differs, adapting.

    Returns:
        Whether it came to its end.
    """
    folder = plan.folder(robot, seed, f"bus_{name}{f'_{shift}' if shift else ''}")
    if (folder / "table.csv").is_file():
        return True
    shutil.rmtree(folder, ignore_errors=True)  # a deployment takes seconds
    hidden = f"robot.hidden=conf/shift/{SHIFTS[robot][shift]}.yaml" if shift else None
    words = [
        "run=deploy",
        f"checkpoint={plan.folder(robot, seed, name)}",
        f"robot={robot}",
        f"trials={TRIALS}",
        f"seed={seed}",
        "stops={odd_voltage: 0.4, stray: 2.0}",  # a lower supply and legs that give are no faults
        *([hidden, *CLIMB] if hidden else ["adapt=none"]),
    ]
    if not deployed(words, folder):
        return False
    shutil.rmtree(folder / "logs", ignore_errors=True)
    return True


def deployed(words: list[str], folder: Path) -> bool:
    """Run a deployment in this process; return whether it came to its end."""
    try:
        verb, arguments = instantiate(compose(words), folder)
        verb(**arguments)
    except (Sim2RealError, HardwareError) as error:
        print(f"{folder}: {error}", file=sys.stderr)
        return False
    return True


def phases(folder: Path) -> dict[str, list[float]] | None:
    """Return the returns on the bus by phase, or None where it is not complete."""
    if not (folder / "table.csv").is_file():
        return None
    found: dict[str, list[float]] = {}
    for row in read_csv(folder / "returns.csv"):
        found.setdefault(row["phase"], []).append(float(row["return"]))
    return found


def gather(plan: Plan, robot: str, seed: int) -> dict[str, float]:
    """Return the figures of one robot and seed, by name, as far as they are there."""
    figures: dict[str, float] = {}
    for training in TRAININGS:
        name, folder = training.name, plan.folder(robot, seed, training.name)
        files = sorted(folder.glob("transfer-*.json"))
        if files:
            (scores,) = read(files[-1])
            figures[f"{name}.steps"] = float(scores.frames)
            if (folder / "cpu.json").is_file():
                figures[f"{name}.minutes"] = cpu_minutes(folder)
            for world in ("ideal", "servo"):
                figures[f"{name}.in_{world}"] = float(scores.returns[world].mean())
        told = phases(plan.folder(robot, seed, f"bus_{name}"))
        if told:
            figures[f"{name}.on_bus"] = fmean(told["as trained"])
    for shift in SHIFTS[robot]:
        told = phases(plan.folder(robot, seed, f"bus_esmaml_{shift}"))
        if told:
            figures[f"{shift}.before"] = fmean(told["as trained"])
            figures[f"{shift}.after"] = fmean(told["adapted"])
            figures[f"{shift}.episodes"] = float(len(told["adapting"]))
    return figures


def collect(plan: Plan) -> None:
    """Write robots.csv, .md and .png of what is complete."""
    found: Figures = {}
    for robot in plan.robots:
        seeds = {seed: gather(plan, robot, seed) for seed in plan.seeds}
        found[robot] = {seed: figures for seed, figures in seeds.items() if figures}
    if any(found.values()):
        write(found, plan.results)


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command("robots", __doc__, "out", "results", "report", "set")
    add = parser.add_argument
    add("--robots", nargs="+", default=list(ROBOTS), choices=ROBOTS, help="default: both")
    add("--seeds", type=at_least(0), nargs="+", default=[0, 1, 2, 3, 4], help="training seeds")
    chosen = parser.parse_args(arguments)
    only = chosen.__dict__.pop("report")
    plan = Plan(**vars(chosen))
    if only:
        collect(plan)
        return 0
    return int(run(plan) > 0)


if __name__ == "__main__":
    sys.exit(main())
