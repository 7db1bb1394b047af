"""Parts of a user's own: a folder of YAML groups and Python modules, outside the repository.

    sim2real +experiment=mine --config-dir my_parts     # or: export SIM2REAL_CONFIG_DIR=my_parts

    my_parts/
      experiment/mine.yaml        # as in conf/experiment
      transforms/noisy.yaml       # _target_: my_transforms.Noisy
      robot/my_arm.yaml
      my_transforms.py            # importable by its name, and allowed as a _target_

All modules of the folder are imported before a verb starts, so that one may register an effect, a
log format or a check. Only who starts the program names the folder: no checkpoint, log or
configuration file can.
"""

import importlib
import os
import sys
from importlib.util import find_spec
from pathlib import Path

from sim2real.config import signatures
from sim2real.config.targets import ConfigError

VARIABLE = "SIM2REAL_CONFIG_DIR"  # set for processes that a run starts
OPTIONS = ("--config-dir", "-cd")


def of_arguments(arguments: list[str]) -> str | None:
    """Return the folder that a command line names, else the environment's; None for none."""
    for number, argument in enumerate(arguments):
        option, equals, value = argument.partition("=")
        if option in OPTIONS:
            if equals:
                return value
            if number + 1 < len(arguments):
                return arguments[number + 1]
            raise ConfigError(f"{option} needs a folder")
    return os.environ.get(VARIABLE) or None


def without_option(arguments: list[str]) -> list[str]:
    """Return a command line without the option that names the folder."""
    kept, skip = [], False
    for argument in arguments:
        if not skip and argument.partition("=")[0] not in OPTIONS:
            kept.append(argument)
        skip = argument in OPTIONS and not skip
    return kept


def activate(folder: str | Path | None) -> None:
    """Put a folder's YAML groups and modules in reach of this process and those it starts.

    Raises:
        ConfigError: there is no such folder, or one of its modules would hide another's.
    """
    if folder is None:
        return
    place = Path(folder).expanduser().resolve()
    if not place.is_dir():
        raise ConfigError(f"--config-dir {folder}: no such folder")
    os.environ[VARIABLE] = str(place)
    if signatures.OWN.get("") == place:
        return
    for name in modules(place):
        found = find_spec(name)
        elsewhere = found is not None and not str(found.origin or place).startswith(str(place))
        if name in signatures.PACKAGES or elsewhere:
            raise ConfigError(
                f"{place / name}: a module {name!r} exists already "
                f"({found.origin if found else 'in this project'}); rename yours"
            )
    signatures.OWN.clear()
    signatures.OWN.update({"": place, **{name: place for name in modules(place)}})
    signatures.clear_cache()
    sys.path.append(str(place))


def folder() -> Path | None:
    """Return the folder that is in use."""
    return signatures.OWN.get("")


def modules(place: Path) -> list[str]:
    """Return the names of a folder's modules and packages."""
    found = [path.stem for path in place.glob("*.py")]
    found += [path.parent.name for path in place.glob("*/__init__.py")]
    return sorted(name for name in found if name.isidentifier())


def load() -> None:
    """Import every module of the folder in use.

    Raises:
        ConfigError: a module that cannot be imported.
    """
    place = folder()
    for name in modules(place) if place else ():
        try:
            importlib.import_module(name)
        except Exception as error:
            why = f"{type(error).__name__}: {error}"
            raise ConfigError(f"{place}: the module {name!r} cannot be imported: {why}") from error
