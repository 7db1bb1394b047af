"""`robot_ci.yaml`: what a robot is compared with each night, and what may change.

    recording: golden/               # logs of the robot when it was right
    model: arm.xml                   # null or left out: the one that each log names
    effects: effects.yaml            # what it had then; left out: fitted to both sides
    remounted: false                 # whether it may have been mounted anew since
    watch: [coulomb_friction, encoder_offset, backlash]
    limits: {coulomb_friction: 0.02, encoder_offset: 0.01}

    given = read_guard("robot_ci.yaml")          # arguments of `compare`

Paths are relative to the file.
"""

from pathlib import Path
from typing import Any

import yaml

from envs.errors import did_you_mean
from sim2real.runs.errors import Sim2RealError

PATHS = {"recording": "before", "model": "model", "effects": "effects"}  # and their arguments
PLAIN = {
    "remounted": (bool, "true or false"),
    "watch": (list, "a list of effects"),
    "limits": (dict, "a mapping of effects"),
}
KEYS = (*PATHS, *PLAIN)


class GuardError(Sim2RealError):
    """A robot_ci.yaml is wrong."""


def read_guard(path: str | Path) -> dict[str, Any]:
    """Read a robot_ci.yaml as arguments of `compare`.

    Raises:
        GuardError: with the file, the key, the value and what is allowed.
    """
    path = Path(path).expanduser()
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise GuardError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    if not isinstance(content, dict):
        raise GuardError(f"{path}: expected a mapping of {', '.join(KEYS)}")
    for key in content:
        if key not in KEYS:
            hint = did_you_mean(str(key), KEYS)
            raise GuardError(f"{path}: unknown key {key!r}{hint}; keys are {', '.join(KEYS)}")
    if not content.get("recording"):
        raise GuardError(f"{path}: recording is missing; name the logs of the robot as it was")
    given = {key: value for key, value in content.items() if value is not None}
    for key, (kind, words) in PLAIN.items():
        if key in given and not isinstance(given[key], kind):
            raise GuardError(f"{path}: {key}={given[key]!r} must be {words}")
    places = {PATHS[key]: _beside(path, given.pop(key), key) for key in PATHS if key in given}
    return given | places


def _beside(path: Path, value: Any, key: str) -> str | list[str]:
    """Return a path or paths as seen from the file's folder; all of them must be there."""
    several = value if isinstance(value, list) else [value]
    found = []
    for one in several:
        place = path.parent / Path(str(one)).expanduser()
        if not place.exists():
            raise GuardError(f"{path}: {key}={one}: no such file or folder")
        found.append(str(place))
    return found if isinstance(value, list) else found[0]
