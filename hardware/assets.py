"""Find a robot's MJCF: a file of the project, or the user's own."""

from pathlib import Path
from typing import Any

from hardware.errors import RobotError, did_you_mean, format_names

ASSETS = Path(__file__).resolve().parent.parent / "envs" / "assets"


def find_model(name: Any, place: str) -> Path:
    """Return the file of a robot's model; raises RobotError where there is none."""
    if name is None:
        raise RobotError(
            f"{place}: this robot's MJCF is not part of the project; give robot.model=PATH "
            "(python -m hardware: model=PATH), with an actuator for each servo, of the same name"
        )
    for path in (Path(name), ASSETS / name):
        if path.is_file():
            return path
    known = sorted(file.name for file in ASSETS.glob("*.xml"))
    hint = did_you_mean(str(name), known)
    raise RobotError(f"{place}: no file {str(name)!r}{hint}; {ASSETS} has {format_names(known)}")
