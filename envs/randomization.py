"""Task distributions: which robots the training sees.

draws = [Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0),
         {"effect": "ground_friction", "low": 1.5, "high": 2.5}]    # as in YAML
tasks = Randomization(draws)
simulation = Simulation(Hopper(), num_rows=256, effects=tasks.effects)
tasks.check(simulation.space)                       # before any work starts
values = tasks.sample(np.random.default_rng(0), 256)    # (256, 2)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, Protocol

import numpy as np
from scipy.stats import truncnorm

from envs.effects.base import Effect
from envs.effects.registry import named
from envs.errors import ParameterError, refuse_unknown
from envs.params import ParamSpace

Distribution = Literal["uniform", "normal", "truncated_normal", "ends"]
FARTHEST = (
    6.0  # standard deviations of a normal draw that must stay within what the parameter means
)


class Tasks(Protocol):
    """A distribution over points of a parameter space."""

    effects: tuple[Effect, ...]
    per: Literal["reset", "row"]  # how long a row keeps its draw

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n points, (n, P)."""
        ...

    def check(self, space: ParamSpace) -> None:
        """Raise ParameterError if a draw could leave the space, or the space is another one."""
        ...


@dataclass(frozen=True)
class Draw:
    """The independent distributions of one effect's parameters.

    Args:
        effect: what is randomized.
        distribution: "uniform" in [low, high]; "normal" (mean, std); "truncated_normal" (all four);
            "ends": low or high, each as likely.
        low: smallest value, in the parameter's unit and way (set, add or scale).
        high: largest value.
        mean: the mean of the normal law before truncation.
        std: standard deviation of the normal law before truncation.

    Raises:
        ParameterError: numbers missing for the law, low above high, or a std that is not positive.
    """

    effect: Effect
    distribution: Distribution = "uniform"
    low: float | None = None
    high: float | None = None
    mean: float | None = None
    std: float | None = None

    def __post_init__(self) -> None:
        name = self.effect.label()
        needs: dict[str, tuple[str, ...]] = {
            "uniform": ("low", "high"),
            "normal": ("mean", "std"),
            "ends": ("low", "high"),
        }
        needs["truncated_normal"] = needs["uniform"] + needs["normal"]
        refuse_unknown(f"{name}: distribution", self.distribution, needs, ParameterError)
        missing = [key for key in needs[self.distribution] if getattr(self, key) is None]
        if missing:
            raise ParameterError(f"{name}: {self.distribution} also needs {', '.join(missing)}")
        for key in ("low", "high", "mean", "std"):
            value = getattr(self, key)
            if value is None:
                continue
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not math.isfinite(value):
                raise ParameterError(f"{name}: {key}={value!r} must be a finite number")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ParameterError(f"{name}: low={self.low:g} is above high={self.high:g}; swap them")
        if self.std is not None and not self.std > 0:
            raise ParameterError(
                f"{name}: std={self.std:g} must be positive;"
                " for one value use uniform with low = high"
            )

    @classmethod
    def of(cls, entry: Mapping[str, Any], place: str) -> Draw:
        """Return the draw of a mapping such as {effect: link_mass, where: torso, low: 1, high: 9}.

        Args:
            entry: the effect by its standard name with its arguments, and how it is drawn.
            place: where the mapping is, for messages.

        Raises:
            EffectError: an effect, or a key, that is not there.
            ParameterError: see `Draw`.
        """
        law = {key: value for key, value in entry.items() if key in LAW}
        effect = {key: value for key, value in entry.items() if key not in LAW}
        made = named(effect, place, LAW)
        try:
            return cls(made, **law)
        except ParameterError as error:
            raise ParameterError(f"{place}: {error}") from None

    @property
    def reach(self) -> tuple[float, float]:
        """The smallest and largest value of a draw (a normal law: 6 standard deviations)."""
        if self.distribution == "normal":
            return self.mean - FARTHEST * self.std, self.mean + FARTHEST * self.std  # type: ignore[operator]
        return self.low, self.high  # type: ignore[return-value]

    def sample(self, rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
        """Draw values of the given shape."""
        if self.distribution == "uniform":
            return rng.uniform(self.low, self.high, shape)  # type: ignore[arg-type]
        low, high = self.reach
        if self.distribution == "ends":
            return rng.choice([low, high], shape)
        a, b = (low - self.mean) / self.std, (high - self.mean) / self.std  # type: ignore[operator]
        law = truncnorm(a, b, loc=self.mean, scale=self.std)
        return np.asarray(law.rvs(size=shape, random_state=rng))


LAW = tuple(one.name for one in fields(Draw) if one.name != "effect")


class Randomization:
    """Independent draws of several effects' parameters.

    Args:
        draws: one for each effect, or mappings of its keys; see `Draw.of`.
        per: "reset" draws for each episode; "row" once for each row of an environment, which
            keeps its robot.

    Raises:
        EffectError: unknown effect, or unknown key of a draw.
        ParameterError: an unknown `per`; see also `Draw`.
    """

    def __init__(
        self, draws: Sequence[Draw | Mapping[str, Any]] = (), per: Literal["reset", "row"] = "reset"
    ) -> None:
        refuse_unknown("per", per, ("reset", "row"), ParameterError)
        self.draws = tuple(
            draw if isinstance(draw, Draw) else Draw.of(draw, f"draws[{number}]")
            for number, draw in enumerate(draws)
        )
        self.per: Literal["reset", "row"] = per
        self.effects = tuple(draw.effect for draw in self.draws)
        self._columns: list[int] | None = None

    def check(self, space: ParamSpace) -> None:
        """Bind to the space of a simulation that was made with these effects; see `Tasks.check`."""
        columns, drawn = [], []
        for draw in self.draws:
            own = [
                p for p in space.parameters if (p.effect, p.where, p.side) == _place(draw.effect)
            ]
            drawn += [p.name for p in own]
            if not own:
                raise ParameterError(
                    f"{draw.effect.label()} is drawn, but the simulation was made without it"
                )
            low, high = draw.reach
            for p in own:
                if low < p.low or high > p.high:
                    raise ParameterError(
                        f"{p.name}: draws reach [{low:g}, {high:g}] {p.unit}, outside"
                        f" [{p.low:g}, {p.high:g}] ({p.how}); narrow the range"
                    )
            columns.append(len(own))
        if left := [name for name in space.names if name not in drawn]:
            raise ParameterError(
                f"the simulation has {', '.join(left)}, but nothing draws them; choose params=NAME "
                "that does (sim2real --help lists them)"
            )
        if len(drawn) > space.size:
            raise ParameterError(f"the draws of {', '.join(drawn)} repeat one; leave it out")
        self._columns = columns

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n points, (n, P), in the order of the draws; call `check` first."""
        if not self.draws:
            return np.zeros((n, 0))
        if self._columns is None:
            raise ParameterError(
                "check(space) the randomization against a simulation before drawing from it"
            )
        parts = [
            draw.sample(rng, (n, k)) for draw, k in zip(self.draws, self._columns, strict=True)
        ]
        return np.concatenate([np.zeros((n, 0)), *parts], axis=1)


def _place(effect: Effect) -> tuple[str, str | None, str | None]:
    return effect.name, effect.where, effect.side
