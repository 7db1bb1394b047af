"""Keys that a file leaves at their default are set like any other, without Hydra's plus.

    with_plus(["robot=hopper2", "robot.servos.hip.sign=-1"])
    # ["robot=hopper2", "+robot.servos.hip.sign=-1"]

Hydra takes KEY=VALUE only for a key that a file writes out. A key gets its plus here if the class
that reads it has it, or refuses an unknown key by name.
"""

import re
from typing import Any

from hydra.errors import HydraException
from omegaconf import DictConfig, ListConfig
from omegaconf.errors import OmegaConfBaseException

from sim2real.config import signatures
from sim2real.config.hydra_compose import hydra_compose

ROOT = "sim2real.config.compose.Config"
REFUSING = ("robot", "stops", "limits")  # what reads these names a key that it does not know
NESTED = re.compile(r"\w+(\.\w+)+=")


def with_plus(overrides: list[str], job: list[str]) -> list[str]:
    """Return overrides with a plus at each key that is left at its default.

    Args:
        overrides: as on the command line, sweeps among them.
        job: one job of theirs.
    """
    nested = [line for line in overrides if NESTED.match(line)]
    if not nested:
        return overrides
    try:
        tree = hydra_compose([line for line in job if not NESTED.match(line)])
    except (HydraException, OmegaConfBaseException):
        return overrides  # whoever composes them all says what is wrong
    keys = {line: line.partition("=")[0].split(".") for line in nested}
    return [f"+{x}" if x in keys and _is_left_out(tree, keys[x]) else x for x in overrides]


def _is_left_out(tree: DictConfig, names: list[str]) -> bool:
    node: Any = tree
    found, takes = signatures.find(ROOT), None  # a node's class, and what the node is given for
    for name in names[:-1]:
        takes = found.arguments.get(name) if found else takes and takes.inner()
        node = _item(node, name)
        found = _signature(node)
    if names[0] in REFUSING:
        return not isinstance(node, DictConfig) or names[-1] not in node
    if not isinstance(node, DictConfig) or names[-1] in node or takes is None:
        return False
    if found:  # what is made later gets arguments of the program's, too
        return names[-1] in found.arguments and not takes.makes
    return takes.is_object_or_its_keys


def _item(node: Any, name: str) -> Any:
    if isinstance(node, ListConfig):
        return node[int(name)] if name.isdecimal() and int(name) < len(node) else None
    return node.get(name) if isinstance(node, DictConfig) else None


def _signature(node: Any) -> signatures.Signature | None:
    target = node.get("_target_") if isinstance(node, DictConfig) else None
    return signatures.find(target) if isinstance(target, str) else None
