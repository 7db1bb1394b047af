"""The steps of one seed, each skipped where it is done and continued where it was stopped."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from benchmarks.easi.demonstrations import demonstrate
from benchmarks.easi.plan import ROUNDS, ROWS, Plan, Row
from benchmarks.robots import timed
from benchmarks.study import sim2real, trained
from envs.distribution import Distribution, Entry
from envs.distribution_file import read, write
from envs.marginals import Marginal, uniform
from envs.simulation import Simulation
from sim2real.config.compose import compose
from sim2real.config.targets import build
from sim2real.identification.outcome import FILE
from sim2real.identification.prior import prior_from_tasks
from sim2real.runs.files import folder_lock

LOG = "demonstrations.csv"
BEYOND = 2.0  # a further target's prior goes so many times as far: from a sixth to six times


def run(plan: Plan) -> int:
    """Do all that is not yet done; return how many jobs failed, the others went on."""
    return in_rounds(plan, follow)


def in_rounds(plan: Plan, follow: Callable[[Plan, Row, int], bool]) -> int:
    """Follow the wanted rows, the most telling ones of all seeds first.

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
    with folder_lock(folder) as mine:
        if not mine or evaluated(folder, plan.frames):
            return True
        if row.name == "udr" and plan.target is not None:
            return elsewhere(plan, row, seed)
        robots = found(plan, row, seed)
        if robots is None:
            return False
        frames = [] if plan.frames is None else [f"frames={plan.frames}"]
        with timed(folder):
            return sim2real(
                f"+experiment={plan.study.experiment}",
                f"seed={seed}",
                "video=none",
                "keep_checkpoints=1",
                f"hydra.run.dir={folder}",
                *([f"resume={folder}"] if trained(folder) else []),
                *frames,
                *robots,
                *judged(plan),
                *plan.overrides,
            )


def elsewhere(plan: Plan, row: Row, seed: int) -> bool:
    """Evaluate uniform randomization's policy, which knows no target, on another target."""
    policy = plan.home.folder(seed, row.name)
    if not follow(plan.home, row, seed) or not evaluated(policy, plan.frames):
        return False
    folder = plan.folder(seed, row.name)
    words = (f"checkpoint={policy}", f"seed={seed}", "eval=target", *judged(plan))
    return sim2real("run=evaluate", f"hydra.run.dir={folder}", *words)


def judged(plan: Plan) -> list[str]:
    """Return the settings that make the target what a policy is evaluated on."""
    return [] if plan.effects is None else [f"+eval.robots.target.effects={plan.effects}"]


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
        return target(plan)
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


def target(plan: Plan) -> list[str]:
    """Return the settings of a training on the target itself."""
    return ["params=none", *([] if plan.effects is None else [f"effects={plan.effects}"])]


def tuned(plan: Plan, row: Row, seed: int) -> list[str] | None:
    """Return the settings of a training that goes on from uniform randomization's policy."""
    policy = plan.home.folder(seed, "udr")
    if not (behind := evaluated_at(policy)):
        return None
    steps = behind + row.budget * plan.study.task().max_steps
    return [*target(plan), f"start={policy}", f"frames={steps}"]


def identified(plan: Plan, row: Row, seed: int) -> Path | None:
    """Let EASI find a row's distribution; return its file, None where that failed."""
    policy, log = demonstrations(plan, row, seed)
    if row.identify is None or log is None:
        return None
    folder = plan.folder(seed, f"identify_{row.identify}_{row.budget}")
    words = (f"identify={row.identify}", *looked_for(plan), f"checkpoint={policy}")
    return identify(plan, folder, log, seed, (*words, *plan.study.identify, *plan.identify))


def demonstrations(plan: Plan, row: Row, seed: int) -> tuple[Path, Path | None]:
    """Return uniform randomization's policy and what it did on the target; None without one."""
    policy = plan.home.folder(seed, "udr")
    if not evaluated(policy, None):
        return policy, None
    place = plan.folder(seed, f"demonstrations_{row.budget}")
    return policy, demonstrated(place, policy, row.budget, seed, plan.effects)


def looked_for(plan: Plan) -> list[str]:
    """Return the settings of EASI's prior: what is randomized, and for another target beyond it."""
    if plan.target is None:
        return [f"params={plan.study.params}"]
    return ["params=distribution", f"params.path={prior_file(plan)}"]


def prior_file(plan: Plan) -> Path:
    """Return a file of the prior; as effects it is the prior's mean."""
    path = plan.out / plan.label / "prior.yaml"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, prior(plan))
    return path


def identify(plan: Plan, folder: Path, log: Path, seed: int, words: tuple[str, ...]) -> Path | None:
    """Run one identification, from where it stopped; return its file, None where it failed."""
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
    folder: Path, policy: Path, budget: int, seed: int, effects: str | Path | None = None
) -> Path:
    """Return the log of so many trajectories of a policy on the target; make it if need be."""
    path = folder / LOG
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        demonstrate(policy, budget, seed, path, effects)
    return path


def prior(plan: Plan) -> Distribution:
    """Return EASI's prior: what uniform randomization draws, for another target BEYOND as far."""
    before = prior_from_tasks(build(compose([f"params={plan.study.params}"])["params"], "params"))
    if plan.target is None:
        return before
    space = Simulation(plan.study.task(), 1, before.effects, 1).space
    entries = tuple(
        replace(e, laws=(uniform(max(law.low / BEYOND, p.low), min(law.high * BEYOND, p.high)),))
        for e, law, p in zip(before.entries, before.laws, space.parameters, strict=True)
    )
    return replace(before, entries=entries)


def narrowed(before: Distribution, after: Distribution) -> Distribution:
    """Return the widths that were found, about the middle of the prior."""
    laws = [
        Marginal("normal", law.mean, new.std, law.low, law.high)
        for law, new in zip(before.laws, after.laws, strict=True)
    ]
    entries = tuple(Entry(e.effect, (law,)) for e, law in zip(before.entries, laws, strict=True))
    return replace(before, entries=entries)
