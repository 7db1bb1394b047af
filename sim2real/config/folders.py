"""Folders of runs and paths that a command line names: which are there, which are free.

free_folder("outputs/train/smoke/2026-11-21_10-00-00")   # made; a second one ends in _2
run_folder(Path("outputs/train/smoke/2026-11-21_10-00-00/checkpoints/checkpoint-10.torchrl"))
"""

from collections.abc import Collection
from pathlib import Path
from typing import Any

from envs.errors import did_you_mean
from hardware.log_writer import check_free
from sim2real.config.arguments import PATHS
from sim2real.config.targets import ConfigError

# convert writes the first of these; the others may be names, of a description and of a robot
READ = tuple(key for key in PATHS if key not in ("columns", "observation", "leader"))
NAMES = ("candidates",)  # of these a list holds names, and no paths
NEEDED = {  # by verb, what it cannot do without
    "diagnose": "log",
    "identify": "log",
    "replay": "log",
    "contract": "log",
    "convert": "log",
    "evaluate": "checkpoint",
    "export": "checkpoint",
    "worth": "checkpoint",
    "improve": "checkpoint",
    "deploy": "checkpoint",
    "report": "runs",
}
STARTED_BY_RESUME = ("blindcheck",)  # one line starts an exam and continues it
FOLDERS = 1000  # runs that may start in one second


def free_folder(wanted: str) -> str:
    """Make a folder that was not there, and return its name: that wanted, or with a number.

    Two runs that start in one second get two folders. A folder that cannot be made is left to
    Hydra, which says so.
    """
    for number in range(1, FOLDERS):
        name = wanted if number == 1 else f"{wanted}_{number}"
        try:
            Path(name).mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError:
            break
        return name
    return wanted


def check_exists(key: str, path: Path) -> None:
    """Refuse a path of a key that leads nowhere, with the nearest name in its folder.

    Raises:
        ConfigError: there is no such file or folder.
    """
    if not path.exists():
        near = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        hint = did_you_mean(path.name, near)
        raise ConfigError(f"{key}={path}: no such file or folder{hint}")


def check_paths_exist(tree: dict[str, Any], used: Collection[str]) -> None:
    """Refuse paths that lead nowhere before a run's folder is made.

    Args:
        tree: a checked configuration.
        used: the root keys that its verb uses.

    Raises:
        ConfigError: a log, a model, a checkpoint or another file that does not exist, with the
            nearest name in its folder, or was not given to a verb that needs it.
    """
    verb = tree["run"]["_target_"].split(".")[-2]
    needed = NEEDED.get(verb)
    without = {"export": tree["effects"] or tree["to"], "improve": tree["by"] == "returns"}
    if needed is not None and not tree[needed] and not without.get(verb):
        raise ConfigError(f"{verb} needs {needed}=PATH; `sim2real {verb} PATH` is the same")
    begun = {"resume"} if verb in STARTED_BY_RESUME else set()
    for key in (one for one in READ if one in used and one not in begun):
        given = tree[key] if isinstance(tree[key], list) else [tree[key]]
        if key in NAMES and isinstance(tree[key], list):
            continue
        for one in given:
            if one:
                check_exists(key, Path(str(one)).expanduser())


def check_output_is_free(out: Path, tree: dict[str, Any]) -> None:
    """Keep a new training or recording out of a folder that holds another, before it is touched.

    Raises:
        ConfigError: the folder has checkpoints and this run does not resume.
        LogError: the folder has a log where `record` would write one.
    """
    if tree["run"]["_target_"] == "sim2real.verbs.record.run":
        check_free(out / "log.csv")
    if tree.get("resume") is None and any((out / "checkpoints").glob("checkpoint-*")):
        raise ConfigError(f"{out} already holds a run; continue it with resume={out}")


def run_folder(path: Path) -> Path | None:
    """Return the folder of the run that a checkpoint, a run's or a sweep's folder belongs to.

    None where no run was started by the command line.
    """
    path = path.expanduser().absolute()
    candidates = [path, *path.parents[:2], *sorted(path.glob("*/"))]
    return next((f for f in candidates if (f / ".hydra" / "overrides.yaml").is_file()), None)
