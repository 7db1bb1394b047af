"""A distribution of robots: what an identification finds, and what a training draws from.

    found = read("distribution.yaml")
    found.names, found.mean, found.std             # (P,) each
    values = found.sample(np.random.default_rng(0), 256)       # (256, P)

It is `Tasks` (see `envs.randomization`): `params=distribution params.path=distribution.yaml` trains
under it. `spread` (how much the robot varies between episodes) and `uncertainty` (how well the
estimate is known) are kept apart; draws have both, `std` is their root sum of squares.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.special import ndtr

from envs.effects.base import Effect
from envs.errors import ParameterError, refuse_unknown
from envs.marginals import Marginal
from envs.params import ParamSpace

NEAR = 1e-6  # a correlation matrix may miss its properties by so much, from being written as text
FIRST, LAST = 1e-12, 1 - 1e-12  # shares of a law that draws reach: its ends are not finite


@dataclass(frozen=True)
class Entry:
    """One effect and the laws of its parameters.

    Args:
        effect: what is distributed.
        laws: of its parameters; the effect's extras are constants.
        spread: standard deviation between episodes of each; None where it is not known.
        uncertainty: standard deviation of the estimate of each mean; None where it is not known.
    """

    effect: Effect
    laws: tuple[Marginal, ...]
    spread: tuple[float, ...] | None = None
    uncertainty: tuple[float, ...] | None = None


@dataclass(frozen=True)
class UnidentifiedDirection:
    """A direction of the parameters that the data do not identify.

    Args:
        parameters: weight of each parameter in it, the largest first, in widths of the prior.
        known: reduction of the width from prior to estimate, 0 (none) to 1.
    """

    parameters: Mapping[str, float]
    known: float


@dataclass(frozen=True)
class Distribution:
    """Laws of P parameters and how they go together.

    Args:
        entries: the effects with their laws.
        joint: correlation of the normal numbers behind the laws (a Gaussian copula), (P, P); None:
            independent.
        particles: draws of all parameters, (n, P), where the laws are "particles"; else None.
        made_by: the method and its settings.
        logs: SHA-256 of each log, by name.
        flat: directions in which the logs say nothing.
        noise: gap that is left at each joint and made by no draw, root mean square [rad or m].
        per: "reset" draws for each episode; "row" once for each row.

    Raises:
        ParameterError: no entries, a joint that is not a correlation matrix, laws that mix
            particles and others, particles of another number of parameters, an unknown `per`.
    """

    entries: tuple[Entry, ...]
    joint: np.ndarray | None = None
    particles: np.ndarray | None = None
    made_by: Mapping[str, Any] = field(default_factory=dict)
    logs: Mapping[str, str] = field(default_factory=dict)
    flat: tuple[UnidentifiedDirection, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    per: Literal["reset", "row"] = "reset"

    def __post_init__(self) -> None:
        refuse_unknown("per", self.per, ("reset", "row"), ParameterError)
        if not self.entries:
            raise ParameterError("a distribution needs at least one entry")
        for entry in self.entries:
            if entry.effect.free:
                raise ParameterError(
                    f"{entry.effect.label()}: free={list(entry.effect.free)} are not allowed in a "
                    f"distribution; give these extras values"
                )
        if len(set(self.names)) < len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise ParameterError(f"{twice} is given twice; keep one of them")
        _check_joint(self)

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, in the order of the entries."""
        return tuple(entry.effect for entry in self.entries)

    @property
    def laws(self) -> tuple[Marginal, ...]:
        """The laws of all parameters, P of them."""
        return tuple(law for entry in self.entries for law in entry.laws)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters, P of them."""
        return tuple(name for entry in self.entries for name in names_of(entry))

    @property
    def mean(self) -> np.ndarray:
        """(P,)."""
        return np.array([law.mean for law in self.laws])

    @property
    def std(self) -> np.ndarray:
        """(P,)."""
        return np.array([law.std for law in self.laws])

    @property
    def low(self) -> np.ndarray:
        """(P,)."""
        return np.array([law.low for law in self.laws])

    @property
    def high(self) -> np.ndarray:
        """(P,)."""
        return np.array([law.high for law in self.laws])

    def columns(self, what: Literal["spread", "uncertainty"]) -> np.ndarray:
        """Return the spread or uncertainty of all parameters, (P,); NaN where it is not known."""
        found = [getattr(e, what) or (np.nan,) * len(e.laws) for e in self.entries]
        return np.array([value for values in found for value in values])

    def check(self, space: ParamSpace) -> None:
        """Raise ParameterError if a draw could leave the space, or the space is another one."""
        own = [(e.name, e.where, e.side) for e in self.effects]
        named = [(p.effect, p.where, p.side) for p in space.parameters]
        counts = [named.count(place) for place in own]
        if sum(counts) != space.size or counts != [len(e.laws) for e in self.entries]:
            raise ParameterError(
                f"the distribution has {len(self.names)} parameters ({', '.join(self.names)}), "
                f"the simulation has {space.size} ({', '.join(space.names) or 'none'})"
            )
        for law, parameter in zip(self.laws, space.parameters, strict=True):
            if law.low < parameter.low or law.high > parameter.high:
                raise ParameterError(
                    f"{parameter.name}: draws reach [{law.low:g}, {law.high:g}] {parameter.unit}, "
                    f"outside [{parameter.low:g}, {parameter.high:g}] ({parameter.how}); narrow "
                    "low and high"
                )

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n points, (n, P)."""
        if self.particles is not None:
            return self.particles[rng.integers(len(self.particles), size=n)]
        count = len(self.laws)
        normal = rng.standard_normal((n, count))
        if self.joint is not None:
            values, vectors = np.linalg.eigh(self.joint)
            normal = normal * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
        shares = np.clip(ndtr(normal), FIRST, LAST)
        return np.column_stack([law.values(shares[:, i]) for i, law in enumerate(self.laws)])


def names_of(entry: Entry) -> list[str]:
    """Return the names of an entry's parameters: its effect's label, numbered if it has several."""
    label = entry.effect.label()
    several = len(entry.laws) > 1
    return [f"{label}.{i}" for i in range(len(entry.laws))] if several else [label]


def _check_joint(found: Distribution) -> None:
    """Raise ParameterError for a joint or particles that do not fit the entries."""
    kinds, count = {law.kind for law in found.laws}, len(found.laws)
    if ("particles" in kinds) != (found.particles is not None) or (
        "particles" in kinds and len(kinds) > 1
    ):
        raise ParameterError(
            "law: particles needs a table as joint, and every entry must have that law"
        )
    if found.particles is not None and (
        found.particles.ndim != 2
        or found.particles.shape[1] != count
        or not len(found.particles)
        or not np.isfinite(found.particles).all()
    ):
        raise ParameterError(
            f"the particles must be finite numbers, one row per draw, {count} columns in the "
            f"order of "
            f"the entries; they have shape {found.particles.shape}"
        )
    if found.joint is None:
        return
    joint = found.joint
    if joint.shape != (count, count):
        raise ParameterError(
            f"joint must be a {count} by {count} matrix, in the order of the entries; it has shape "
            f"{joint.shape}"
        )
    if not np.isfinite(joint).all():
        wrong = "it holds a number that is not finite"
    elif np.abs(joint - joint.T).max() > NEAR:
        wrong = "it is not symmetric"
    elif np.abs(np.diag(joint) - 1).max() > NEAR:
        wrong = "its diagonal is not 1"
    elif np.linalg.eigvalsh(joint).min() < -NEAR * count:
        wrong = "some of its correlations contradict each other (a negative eigenvalue)"
    else:
        return
    raise ParameterError(
        f"'joint' is not a correlation matrix: {wrong}. Correct it, or remove the key"
    )
