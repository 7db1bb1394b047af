"""Translate the command line for Hydra: verbs by name, files by position, any path.

    as_overrides(["diagnose", "swing.csv", "arm.xml"])
    # ["run=diagnose", "log=swing.csv", "model=arm.xml"]
    as_overrides(["run=replay", "log=~/runs (new)/a=1.csv"])
    # ["run=replay", "log='/home/me/runs (new)/a=1.csv'"]
    as_overrides(["record", "my_arm.yaml"])     # a robot that is not a choice of conf/robot
    # ["run=record", "~robot", "+robot={name:'my_arm',model:'my_arm.xml',...}"]

Hydra's grammar gives `=`, brackets, commas, spaces and `~` a meaning; a path may hold them all. The
value of a key that holds paths is therefore quoted, unless it is a list, a sweep of several, or
quoted already.
"""

import difflib
import re
from pathlib import Path
from typing import Any

from hardware.robot_files import SUFFIXES, find_robot, read_robot
from sim2real.config.catalogue import CONF, EXPERIMENT, options
from sim2real.config.renamed import ended
from sim2real.config.targets import ConfigError

MODELS = (".xml", ".mjcf", ".urdf")  # what a model's name ends in
PATHS = (
    "log",
    "model",
    "effects",
    "checkpoint",
    "start",
    "resume",
    "runs",
    "calibration",
    "leader",
    "leader_calibration",
    "columns",
    "against",
    "actor",
    "observation",
    "params.path",
    "candidates",
    "before",
    "after",
    "ci",
    "diagnosis",
    "hydra.run.dir",
    "hydra.sweep.dir",
)
PLACES = {  # what stands after a verb without a key
    "diagnose": "log",
    "identify": "log",
    "replay": "log",
    "contract": "log",
    "convert": "log",
    "evaluate": "checkpoint",
    "deploy": "checkpoint",
    "export": "checkpoint",
    "worth": "checkpoint",
    "improve": "checkpoint",
    "view": "robot",
    "record": "robot",
    "report": "runs",
}
OTHERWISE = {"out": "hydra.run.dir", "follower": "robot", "follower_port": "port"}  # other names
WITH_VALUE = ("--cfg", "-c", "--package", "-p", "--info", "-i")  # Hydra's; a word may follow
WITH_VALUE += ("--config-dir", "-cd", "--config-path", "-cp", "--config-name", "-cn")
SPECIAL = re.compile(r"[\s=()\[\]{},'\"\\]")  # what Hydra's grammar does not take in a bare value


def as_overrides(arguments: list[str]) -> list[str]:
    """Return a command line as Hydra's overrides and options.

    Args:
        arguments: the words as typed, without the program's name.

    Raises:
        ConfigError: a verb that ended, a word in a place where the verb takes none, or a key that
            is nearly `experiment`.
    """
    if gone := ended(arguments):
        raise ConfigError(gone)
    words = options_and_words(arguments)[1]
    verb = words[0] if words and words[0] in options("run") else None
    rest = [a for n, a in enumerate(arguments) if not (verb and n == arguments.index(verb))]
    bare = [a for a in words[1:] if verb and not _is_override(a)]
    given = [line for a in rest if a not in bare for line in _readable(a)]
    return ([f"run={verb}"] if verb else []) + _placed(verb or "", bare) + given


def options_and_words(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Return the options of a command line and the words they take, and all other words."""
    chosen, words = [], []
    for before, argument in zip(["", *arguments], arguments, strict=False):
        option = argument.startswith("-") or before in WITH_VALUE
        (chosen if option else words).append(argument)
    return chosen, words


def _is_override(argument: str) -> bool:
    """Return whether an argument sets or deletes a key; a file of that name is a file."""
    if argument.startswith("~/") or Path(argument).expanduser().exists():
        return False
    return "=" in argument or argument.startswith("~")


def _placed(verb: str, words: list[str]) -> list[str]:
    """Give the words after a verb their keys."""
    if not words:
        return []
    if verb not in PLACES:
        raise ConfigError(
            f"{verb} does not accept {words[0]!r}; write KEY=VALUE, see --help for the keys"
        )
    key = PLACES[verb]
    models = [w for w in words if key == "log" and Path(w).suffix.lower() in MODELS]
    values = [w for w in words if w not in models]
    if len(models) > 1:
        raise ConfigError(f"{verb}: {' and '.join(models)} are two models; give one")
    if len(values) > 1 and key not in ("log", "checkpoint", "runs"):
        raise ConfigError(f"{verb} takes one {key}, not {len(values)}: {', '.join(values)}")
    if key == "robot":
        return _robot(values[0])
    quoted = [path_value(value) for value in values]
    made = [f"{key}={quoted[0]}"] if len(quoted) == 1 else []
    made = [f"{key}=[{','.join(quoted)}]"] if len(quoted) > 1 else made
    return made + [f"model={path_value(model)}" for model in models]


def _readable(argument: str) -> list[str]:
    """Return an override whose path, if its value is one, is quoted or read."""
    key, equals, value = argument.partition("=")
    key = OTHERWISE.get(key, key) if equals else key
    name = key.lstrip("+")
    if equals and name == EXPERIMENT:
        return [f"+{EXPERIMENT}={value}"]
    if equals and difflib.get_close_matches(name, [EXPERIMENT], cutoff=0.8):
        raise ConfigError(f"{key}: no such key; did you mean +{EXPERIMENT}={value}?")
    if equals and name == "robot":
        return _robot(value)
    return [f"{key}={path_value(value)}" if equals and name in PATHS else argument]


def _robot(value: str) -> list[str]:
    """Return the overrides that choose a robot of conf/robot, or take the one of a file.

    Raises:
        RobotError: the file is not there, or holds no table.
    """
    if Path(value).suffix not in SUFFIXES:
        return [f"robot={value}"]
    return ["~robot", f"+robot={_value(read_robot(find_robot(value)))}"]


def _value(value: Any) -> str:
    """Write a value that YAML read in Hydra's grammar."""
    if isinstance(value, dict):
        return "{" + ",".join(f"{key}:{_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ",".join(map(_value, value)) + "]"
    if isinstance(value, str):
        return _quoted(value)
    return "null" if value is None else str(value).lower()


def path_value(value: str) -> str:
    """Return a path as a value of Hydra's grammar.

    Args:
        value: a path as typed, a list of them, a sweep, or `null`.
    """
    if not value or value[0] in "['\"" or value.startswith("${"):
        return value
    path = str(Path(value).expanduser()) if value.startswith("~") else value
    several = "," in path and not Path(path).exists()
    if several or not SPECIAL.search(path):
        return path
    return _quoted(path)


def _quoted(value: str) -> str:
    return "'" + value.replace("\\", "\\\\").replace("'", "\\'") + "'"


def find_shadowing_module(root: Path = CONF.parent) -> str | None:
    """Return the file that Python finds instead of one of our packages; None if there is none."""
    from importlib.util import find_spec

    for name in ("envs", "hardware", "sim2real"):
        found = find_spec(name)
        origin = None if found is None else found.origin
        if origin is None or not Path(origin).resolve().is_relative_to(root.resolve()):
            return f"{name} ({origin or 'a folder without __init__.py'})"
    return None
