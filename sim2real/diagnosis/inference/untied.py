"""One effect at all joints, with a value of its own at each.

    untie(member, options)          # `coulomb_friction (each)`, from `coulomb_friction`

Joints of one robot rub, bend and push in the same way, but seldom by the same amount.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.inference.log_change import LogChange

LAW = ("name", "how", "variant")  # what effects of one law have in common, wherever they are
ENDS = ("neutral", "low", "high")


@dataclass(frozen=True, kw_only=True)
class Untied(Candidate):
    """The same effect at several joints."""

    tied: Candidate  # the effect with one value for all of them
    options: tuple[Candidate, ...]  # the effect at each

    @property
    def label(self) -> str:
        """That of one value for all joints, and that each has its own."""
        return f"{super().label} (each)"

    def elaborated(self) -> None:
        """Return None: its values are those of its parts, which have no more each."""

    @property
    def parts(self) -> tuple[Candidate, ...]:
        """What is simulated."""
        return self.options


def untie(member: Candidate | LogChange, options: Sequence[Candidate]) -> Untied | None:
    """Return an effect with one value for all joints as one with a value for each.

    None for any other member, and where the robot has no two such joints among its `options`.
    """
    if not isinstance(member, Candidate) or isinstance(member, Untied) or not member.shared:
        return None
    own = tuple(o for o in options if o.effect.where is not None and _have_one_law(o, member))
    if len(own) < 2:
        return None
    count = max(len(option.probes) for option in own)
    probes = [option.probes[np.minimum(np.arange(count), len(option.probes) - 1)] for option in own]
    neutral, low, high = (
        np.concatenate([getattr(option, name) for option in own]) for name in ENDS
    )
    points = np.concatenate(probes, axis=1)
    laid_out = points, neutral, low, high, member.group
    return Untied(member.effect, None, *laid_out, tied=member, options=own)


def _have_one_law(one: Candidate, other: Candidate) -> bool:
    pairs = ((getattr(own.effect, name) for own in (one, other)) for name in LAW)
    return all(first == second for first, second in pairs)
