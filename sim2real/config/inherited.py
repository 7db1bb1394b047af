"""Inherit settings from the run that a command line names: `checkpoint=`, `start=`, `resume=`.

inherited(["run=evaluate", "checkpoint=outputs/train/udr/RUN"])     # and the run's own choices
"""

from pathlib import Path
from typing import Any

import yaml

from sim2real.config.catalogue import EXPERIMENT
from sim2real.config.folders import run_folder
from sim2real.config.targets import ConfigError

RESOLVED = "config.yaml"
LEARNING = ("collector", "advantage", "loss", "buffer", "optimizer")  # what learns from experience
INHERITED = (  # what a run says about itself
    *("env", "effects", "params", "transforms", "policy", "adapt", "algorithm"),
    *LEARNING,
    "eval",
)
FIXED = (  # what a run that is resumed has and keeps
    *("run", EXPERIMENT, "seed", "env", "effects", "params", "transforms", "policy", "adapt"),
    *("algorithm", *LEARNING),
)
MACHINES = ("shards", "workers", "threads")  # how work is shared: results do not depend on it


def inherited(overrides: list[str]) -> list[str]:
    """Put before the overrides what the run that they name was given.

    Raises:
        ConfigError: see `with_run`.
    """
    return with_run(with_checkpoint(overrides))


def with_run(overrides: list[str]) -> list[str]:
    """Put before the overrides all that the run was given which `resume=` goes on with.

    What says what the run is cannot be said otherwise: that would be another run, under its name.

    Raises:
        ConfigError: a key with another value than the run's.
    """
    given = {key_of(line): line.partition("=")[2] for line in overrides}
    place = given.get("resume", "").strip("\"'")
    folder = run_folder(Path(place)) if place and place != "null" else None
    if folder is None:
        return overrides
    own: list[str] = yaml.safe_load((folder / ".hydra/overrides.yaml").read_text(encoding="utf-8"))
    own = [line for line in own if key_of(line).split(".")[0] not in ("hydra", "resume", "start")]
    for key, value in given.items():
        was = _value(folder, own, key)
        if was is not None and yaml.safe_load(value) != was:
            raise ConfigError(
                f"{key}={value}: the run in {folder} has {key}={was}, and resume= keeps it; "
                "remove the key, or begin a new run (start= continues from its policy)"
            )
    kept = [line for line in own if key_of(line) not in given]
    return [
        line for line in kept if root_of(line) in FIXED or root_of(line) not in given
    ] + overrides


def _value(folder: Path, own: list[str], key: str) -> Any:
    """Return a run's value of a key that identifies it; None for a key that may differ."""
    root, *names = key.split(".")
    if root not in FIXED or (names and names[-1] in MACHINES):
        return None
    if key in (lines := {key_of(line): line.partition("=")[2] for line in own}):
        return yaml.safe_load(lines[key])
    if root in (EXPERIMENT, "run") or not (folder / RESOLVED).is_file():
        return None
    tree: Any = yaml.safe_load((folder / RESOLVED).read_text(encoding="utf-8"))
    if not names and isinstance(tree.get(root), dict):  # a choice of a group
        chosen = yaml.safe_load((folder / ".hydra/hydra.yaml").read_text(encoding="utf-8"))
        return chosen["hydra"]["runtime"]["choices"].get(root)
    for name in (root, *names):
        tree = tree.get(name) if isinstance(tree, dict) else None
    return tree


def with_checkpoint(overrides: list[str]) -> list[str]:
    """Put before the overrides what the run that `checkpoint=` or `start=` points at was given.

    So a checkpoint says itself what its experiment, robot, tasks and policy are. What the user sets
    counts more: `adapt=batch` replaces the run's own choice, `algorithm.shards=1` its value, and an
    experiment all of it. With several checkpoints the first one counts.
    """
    given = {key_of(line): line.partition("=")[2] for line in overrides}
    named = next((given[key] for key in ("checkpoint", "start") if key in given), "")
    path = named.strip("[]\"'").split(",")[0]
    folder = run_folder(Path(path)) if path and EXPERIMENT not in given else None
    if folder is None:
        return overrides
    text = (folder / ".hydra" / "overrides.yaml").read_text(encoding="utf-8")
    kept = []
    for line in yaml.safe_load(text):
        root = root_of(line)
        if root in (*INHERITED, EXPERIMENT) and root not in given and key_of(line) not in given:
            kept.append(line)
    return kept + overrides


def key_of(override: str) -> str:
    """Return the key that an override sets or deletes."""
    group, _, package = override.partition("=")[0].lstrip("+~").partition("@")
    return package or group


def root_of(override: str) -> str:
    """Return the root key that an override sets: `target` for `+env@target=hopper`."""
    return key_of(override).split(".")[0].split("/")[0]
