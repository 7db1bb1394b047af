"""Find a robot's file, and read its content before it is checked.

    read_robot(find_robot("bench1"))        # {"name": "bench1", "model": "bench1.xml", ...}
    read_robot(find_robot("my_robot.yaml"))

Names are those of conf/robot, and of the folder `robot` of the one that SIM2REAL_CONFIG_DIR names.
"""

import os
from pathlib import Path
from typing import Any

import yaml

from hardware.errors import RobotError, did_you_mean, format_names
from hardware.typed import mapping

ROBOTS = Path(__file__).parents[1] / "conf" / "robot"
SUFFIXES = (".yaml", ".yml")  # of a robot that is given by its path


def find_robot(name_or_path: str | Path) -> Path:
    """Return the path of a robot's file, from a name in conf/robot or a path ending in .yaml.

    Raises:
        RobotError: there is no such robot.
    """
    path = Path(name_or_path).expanduser()
    own = os.environ.get("SIM2REAL_CONFIG_DIR")
    places = [ROBOTS, *([Path(own) / "robot"] if own else [])]
    files = {file.stem: file for place in places for file in place.glob("*.yaml")}
    if path.suffix not in SUFFIXES:
        path = files.get(str(name_or_path), ROBOTS / f"{name_or_path}.yaml")
    if not path.is_file():
        known = sorted(files)
        hint = did_you_mean(str(name_or_path), known)
        raise RobotError(
            f"unknown robot {str(name_or_path)!r}{hint}; available: {format_names(known)}"
        )
    return path


class UniqueKeys(yaml.SafeLoader):
    """YAML whose tables have each key once; the last of two would count otherwise."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return a table; raises yaml.YAMLError with the line of a key that is there again."""
        seen = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                line = key.start_mark.line + 1
                raise yaml.YAMLError(f"line {line}: the key {key.value!r} is there twice; keep one")
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def read_robot(path: Path) -> dict[str, Any]:
    """Return the content of a robot's file; a model next to it is named by its path.

    Raises:
        RobotError: it is not YAML, has a key twice, or is not a table.
    """
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), UniqueKeys)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise RobotError(f"{path}: cannot be read as YAML: {error}") from None
    data = dict(mapping(data, str(path)))
    model = path.parent / str(data.get("model"))
    return {**data, "model": str(model)} if model.is_file() else data
