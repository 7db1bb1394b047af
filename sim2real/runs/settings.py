"""The settings that decide what a run computes, in one form whenever the run was made.

    decisive(then) == decisive(now)     # of a stored config.yaml, and of one composed today

Earlier files say `_partial_` also where an argument's type says it, name the class of a drawn
effect in place of its standard name, and write out the first way and the uniform law.
"""

import re
from collections.abc import Mapping
from typing import Any

from envs.effects import EFFECTS

DECISIVE = ("env", "effects", "params", "policy", "adapt", "algorithm")  # keys of the configuration
DRAW = "envs.randomization.Draw"
CLASSES = "envs.effects."
DEFAULTS = (("distribution", "uniform"), ("friction_mode", "contact"), ("inertia", "kept"))


def decisive(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the decisive keys of a run's configuration, None for those that it lacks."""
    return {key: _today(config.get(key)) for key in DECISIVE}


def _today(tree: Any) -> Any:
    if isinstance(tree, list | tuple):
        return [_today(one) for one in tree]
    if not isinstance(tree, Mapping):
        return tree
    tree = {key: _today(one) for key, one in tree.items() if key != "_partial_"}
    target = str(tree.get("_target_"))
    if target.startswith(CLASSES):
        words = re.findall("[A-Z][a-z]*", tree.pop("_target_").removeprefix(CLASSES))
        tree = {"effect": "_".join(words).lower(), **tree}
    if target == DRAW and isinstance(tree.get("effect"), Mapping):
        del tree["_target_"]
        tree = {**tree, **tree["effect"]}
    usual = [("per", "reset")] if "draws" in tree else []
    if tree.get("effect") in EFFECTS:
        usual = [("how", EFFECTS[tree["effect"]].hows[0]), *DEFAULTS]
    return {key: one for key, one in tree.items() if (key, one) not in usual}
