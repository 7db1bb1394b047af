"""The simulator that a policy is trained in next: what was found, as uncertain as it is.

    causes = read_causes("effects.yaml")                    # values with their intervals
    parts = corrected(parts, causes, folder)                # draws robots from them
    describe(folder / "policy", given, folder / "distribution.yaml")

Each value is normal about what was found, with the standard deviation of its interval, and stays in
the range that its parameter has. It takes the place of what the training drew before (`params=`).
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from envs.distribution import Distribution, Entry
from envs.distribution_file import write
from envs.marginals import Marginal
from envs.params import Parameter
from sim2real.config.arguments import path_value
from sim2real.config.catalogue import EXPERIMENT
from sim2real.config.inherited import INHERITED, root_of
from sim2real.evaluation.cause_costs import Cause, CauseTasks
from sim2real.learning.algorithms.base import Components
from sim2real.learning.environment import EnvironmentFactory
from sim2real.runs.files import write_text

FILE = "distribution.yaml"
FARTHEST = 3.0  # standard deviations that draws reach
REPLACED = ("params", "effects")  # groups that the distribution takes the place of
OVERRIDES = Path(".hydra") / "overrides.yaml"


def corrected(parts: Components, causes: Sequence[Cause], folder: Path) -> Components:
    """Return the training's components with robots drawn from the causes, what was known included.

    The folder gets distribution.yaml.
    """
    found = distribution(parts.environment, causes)
    write(folder / FILE, found)
    return replace(parts, environment=replace(parts.environment, tasks=found, fixed=()))


def distribution(environment: EnvironmentFactory, causes: Sequence[Cause]) -> Distribution:
    """Return the laws of causes, within the ranges of the environment's parameters."""
    effects = [cause.effect for cause in causes]
    world = replace(environment, tasks=CauseTasks(effects), fixed=())
    parameters = world.base_rows(1, threads=1).space.parameters
    entries, start = [], 0
    for cause in causes:
        own = parameters[start : start + len(cause.values)]
        start += len(own)
        stds = (cause.std, *np.zeros(len(own) - 1))
        laws = tuple(_law(*one) for one in zip(cause.values, stds, own, strict=True))
        entries.append(Entry(cause.effect, laws, uncertainty=tuple(float(s) for s in stds)))
    return Distribution(tuple(entries), made_by={"method": "diagnosis"})


def _law(value: float, std: float, parameter: Parameter) -> Marginal:
    mean = float(np.clip(value, parameter.low, parameter.high))
    low, high = mean - FARTHEST * std, mean + FARTHEST * std
    return Marginal("normal", mean, float(std), max(low, parameter.low), min(high, parameter.high))


def describe(place: Path, loop: Path, distribution: Path) -> None:
    """Let a folder of training say what it was started with, so that every verb takes its policy.

    Args:
        place: the folder of a training.
        loop: the folder of the loop; nothing is written where no command line started that.
        distribution: what the training draws robots from.
    """
    given = loop / OVERRIDES
    if not given.is_file():
        return
    lines = [
        line
        for line in yaml.safe_load(given.read_text(encoding="utf-8"))
        if (root := root_of(line)) in (*INHERITED, EXPERIMENT) and root not in REPLACED
    ]
    more = ["params=distribution", f"params.path={path_value(str(distribution.resolve()))}"]
    write_text(place / OVERRIDES, yaml.safe_dump([*lines, *more], allow_unicode=True))
