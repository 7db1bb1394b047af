"""The steps of one seed, each skipped where it is done and continued where it was stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmarks.easi.demonstrations import demonstrate
from benchmarks.easi.plan import ROUNDS, ROWS, Plan, Row
from benchmarks.robots import timed
from benchmarks.study import sim2real, trained
from envs.distribution import Distribution, Entry
from envs.distribution_file import read, write
from envs.laws import Law
from sim2real.config.compose import compose
from sim2real.config.targets import build
from sim2real.identification.outcome import FILE
from sim2real.identification.prior import of_tasks
from sim2real.runs.files import claimed

LOG = "demonstrations.csv"


def run(plan: Plan) -> int:
    """Do all that is not yet done, the most telling rows of all seeds first.

    Returns:
        How many jobs failed; the others went on.
    """
    failed = 0
    for rows in ROUNDS:
        for seed in plan.seeds:
            for row in rows:
                if row.name in plan.rows:
                    failed += not follow(plan, row, seed)
    return failed


def follow(plan: Plan, row: Row, seed: int) -> bool:
    """Train one row with one seed, from where it stopped; return whether it came to its end."""
    folder = plan.folder(seed, row.name)
    with claimed(folder) as mine:
        if not mine or evaluated(folder, plan.frames):
            return True
        robots = found(plan, row, seed)
        if robots is None:
            return False
        frames = [] if plan.frames is None else [f"frames={plan.frames}"]
        with timed(folder):
            return sim2real(
                f"+experiment=easi_{plan.name}",
                f"seed={seed}",
                "video=none",
                "keep_checkpoints=1",
                f"hydra.run.dir={folder}",
                *([f"resume={folder}"] if trained(folder) else []),
                *frames,
                *robots,
                *plan.training,
            )


def evaluated(folder: Path, frames: int | None) -> bool:
    """Return whether a training was evaluated after at least that many steps."""
    steps = evaluated_at(folder)
    return steps > 0 and (frames is None or steps >= frames)


def evaluated_at(folder: Path) -> int:
    """Return the steps after which a training was evaluated last; 0: it was not."""
    return max((int(f.stem.rpartition("-")[2]) for f in folder.glob("transfer-*.json")), default=0)


def found(plan: Plan, row: Row, seed: int) -> list[str] | None:
    """Return the settings that give a row its robots; None where what it needs is missing."""
    if row.name == "udr":
        return []
    if row.name == "oracle":
        return ["params=none"]
    if row.name == "tuned":
        return tuned(plan, row, seed)
    source = ROWS[row.source] if row.source else row
    distribution = identified(plan, source, seed)
    if distribution is None:
        return None
    if row.name == "point":
        return ["params=none", f"effects={distribution}"]
    if row.name == "narrow":
        narrow = plan.folder(seed, row.name, FILE)
        write(narrow, narrowed(prior(plan), read(distribution)))
        distribution = narrow
    return ["params=distribution", f"params.path={distribution}"]


def tuned(plan: Plan, row: Row, seed: int) -> list[str] | None:
    """Return the settings of a training that goes on from uniform randomization's policy."""
    policy = plan.folder(seed, "udr")
    if not (behind := evaluated_at(policy)):
        return None
    steps = behind + row.budget * plan.study.task().max_steps
    return ["params=none", f"start={policy}", f"frames={steps}"]


def identified(plan: Plan, row: Row, seed: int) -> Path | None:
    """Let EASI find a row's distribution; return its file, None where that failed."""
    policy = plan.folder(seed, "udr")
    if row.identify is None or not evaluated(policy, None):
        return None
    log = demonstrated(plan.folder(seed, f"demonstrations_{row.budget}"), policy, row.budget, seed)
    folder = plan.folder(seed, f"identify_{row.identify}_{row.budget}")
    words = (f"identify={row.identify}", f"params={plan.study.params}", f"checkpoint={policy}")
    return identify(plan, folder, log, seed, (*words, *plan.study.identify, *plan.identify))


def identify(plan: Plan, folder: Path, log: Path, seed: int, words: tuple[str, ...]) -> Path | None:
    """Run one identification, from where it stopped; return its file, None where it failed.

    Args:
        plan: the study.
        folder: of the run.
        log: the demonstrations.
        seed: of the run.
        words: its method, prior and settings.
    """
    if not (folder / FILE).is_file():
        begun = (folder / "journal.npz").is_file()
        with timed(folder):
            sim2real(
                "run=identify",
                f"log={log}",
                f"model={plan.study.path}",
                f"seed={seed}",
                f"hydra.run.dir={folder}",
                *([f"resume={folder}"] if begun else []),
                *words,
            )
    return folder / FILE if (folder / FILE).is_file() else None


def demonstrated(
    folder: Path, policy: Path, budget: int, seed: int, effects: str | None = None
) -> Path:
    """Return the log of so many trajectories of a policy on the target; make it if need be."""
    path = folder / LOG
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        demonstrate(policy, budget, seed, path, effects)
    return path


def prior(plan: Plan) -> Distribution:
    """Return what uniform randomization draws from, as a prior."""
    tasks = build(compose([f"params={plan.study.params}"])["params"], "params")
    return of_tasks(tasks)


def narrowed(before: Distribution, after: Distribution) -> Distribution:
    """Return the widths that were found, about the middle of the prior."""
    laws = [
        Law("normal", law.mean, new.std, law.low, law.high)
        for law, new in zip(before.laws, after.laws, strict=True)
    ]
    entries = tuple(Entry(e.effect, (law,)) for e, law in zip(before.entries, laws, strict=True))
    return replace(before, entries=entries)
