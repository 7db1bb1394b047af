"""EASI on quad8, whose real robot is the emulated one: another simulator, behind the servos' bus.

    python -m benchmarks.easi --task quad8 --rows udr oracle easi_200 --seeds 0 1 2

Evolution strategies train under uniform randomization; the policy walks on the robot, which hides
softer servos, friction and a late bus (conf/shift/quad8_servos.yaml; `--target` names another);
EASI finds their parameters from what it saw and said there, and a policy is trained under what it
found. All policies walk on the robot.
"""

from pathlib import Path
from statistics import fmean

from benchmarks.easi.plan import Plan, Row
from benchmarks.easi.steps import identify, in_rounds, looked_for
from benchmarks.robots import deployed, phases, timed
from benchmarks.study import sim2real, trained
from sim2real.runs.files import folder_lock, write_text

ROBOT, TRIALS = "quad8", 10
TRAINING = ("eval=none", "video=none", "keep_checkpoints=1")
STOPS = "stops={odd_voltage: 0.4, stray: 2.0}"  # legs that give are no fault
FRESH = 1000  # added to a seed: demonstrations start otherwise than what is judged


def run(plan: Plan) -> int:
    """Do all that is not yet done; return how many jobs failed, the others went on."""
    return in_rounds(plan, follow)


def follow(plan: Plan, row: Row, seed: int) -> bool:
    """Train a row's policy and let it walk on the robot; return whether it came to its end."""
    with folder_lock(plan.folder(seed, row.name)) as mine:
        if not mine:
            return True
        robots = found(plan, row, seed)
        if robots is None:
            return False
        policy = learned(plan, row.name, seed, robots)
        return policy is not None and walked(plan, policy, bus(plan, row.name, seed), TRIALS, seed)


def bus(plan: Plan, name: str, seed: int) -> Path:
    """Return the folder of a policy's walks on the robot."""
    return plan.folder(seed, name, "bus")


def learned(plan: Plan, name: str, seed: int, robots: list[str]) -> Path | None:
    """Return a trained policy's run; None where it failed."""
    folder = plan.training(name, seed)
    if not (folder / "done").is_file():
        go_on = [f"resume={folder}"] if trained(folder) else []
        with timed(folder):
            if not sim2real(
                f"+experiment={plan.study.experiment}",
                *TRAINING,
                f"seed={seed}",
                f"hydra.run.dir={folder}",
                *go_on,
                *robots,
                *plan.overrides,
            ):
                return None
        write_text(folder / "done", "")
    return folder


def walked(plan: Plan, policy: Path, folder: Path, episodes: int, seed: int) -> bool:
    """Let a policy walk on the robot, unless it did; return whether it came to its end."""
    if phases(folder) is not None:
        return True
    begun = [f"resume={folder}"] if (folder / "state.npz").is_file() else []
    words = ["run=deploy", f"checkpoint={policy}", f"robot={ROBOT}", f"trials={episodes}"]
    words += [f"robot.hidden={plan.effects}", f"seed={seed}", STOPS, *begun]
    return deployed(words, folder)


def found(plan: Plan, row: Row, seed: int) -> list[str] | None:
    """Return the settings that give a row its robots; None where what it needs is missing."""
    if row.name == "udr":
        return [f"params={plan.study.params}"]
    if row.name == "oracle":
        return ["params=none", f"effects={plan.effects}"]
    distribution = identified(plan, row, seed)
    return distribution and ["params=distribution", f"params.path={distribution}"]


def identified(plan: Plan, row: Row, seed: int) -> Path | None:
    """Let EASI find a row's distribution from walks of the randomized policy."""
    policy = learned(plan, "udr", seed, [f"params={plan.study.params}"])
    if policy is None:
        return None
    folder = plan.folder(seed, f"demonstrations_{row.budget}")
    if not walked(plan, policy, folder, row.budget, seed + FRESH):
        return None
    words = (f"identify={row.identify}", *looked_for(plan.home), f"checkpoint={policy}")
    place = plan.folder(seed, f"identify_{row.identify}_{row.budget}")
    return identify(plan, place, folder / "logs", seed, (*words, *plan.identify))


def returned(plan: Plan, name: str, seed: int) -> float | None:
    """Return what a row's policy earned on the robot; None: it has not walked."""
    told = phases(bus(plan, name, seed))
    return None if told is None else fmean(next(iter(told.values())))
