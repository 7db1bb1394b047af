"""Small trained runs on servo robots, for the verbs that read a checkpoint."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from torchrl.envs import EnvBase, TransformedEnv

from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build

ES = ["env=bench1", "env.task.seconds=0.4", "policy=mlp", "iterations=1"]
SMALL_ES = [*ES, "algorithm.num_rows=4", "algorithm.shards=1", "algorithm.pairs=2"]
SMALL_PPO = [
    *("env=bench1", "env.task.seconds=0.4", "algorithm=ppo", "policy=actor_critic"),
    *("iterations=1", "algorithm.num_rows=4", "algorithm.steps=32", "algorithm.minibatch_size=32"),
]


def train(out: Path, overrides: list[str]) -> Path:
    """Train as the command line does, and return the run's folder."""
    (out / ".hydra").mkdir(parents=True)
    (out / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump(overrides))
    run_verb(overrides, out)
    return out


def run_verb(overrides: list[str], out: Path, **changes: Any) -> Any:
    """Run a verb as the command line does; `changes` are arguments of it."""
    verb, arguments = instantiate(compose(overrides), out)
    return verb(**arguments | changes)


def make_learner(overrides: list[str], out: Path = Path(), adapts: bool = True) -> Any:
    """Return the algorithm of a command line, untrained."""
    _, given = instantiate(compose(overrides), out)
    return build(given["algorithm"], given["parts"], adapts)


def note_worlds(monkeypatch: pytest.MonkeyPatch) -> list[EnvBase]:
    """Return a list that gets each environment that is built from now on.

    A `TransformedEnv` is none of its own.
    """
    built, make = list[EnvBase](), EnvBase.__init__

    def noted(self: EnvBase, *arguments: Any, **named: Any) -> None:
        make(self, *arguments, **named)
        if not isinstance(self, TransformedEnv):
            built.append(self)

    monkeypatch.setattr(EnvBase, "__init__", noted)
    return built
