"""The outline of a case before it is made."""

from dataclasses import dataclass

KEY = "key.json"  # what a case's key is called in its folder


@dataclass(frozen=True)
class Outline:
    """A case as drawn: its name, kind, robot, effects and the seed of everything else."""

    name: str
    kind: str
    robot: str
    effects: tuple[str, ...]
    seed: int
