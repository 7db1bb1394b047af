"""Each cause looked at again beside all others: another may take its place, or nobody.

    look_back(search, found)

What joined first was chosen while the others were missing. All places are looked at before the
exchange that closes most is made, and the others are looked at again beside whoever came: of a
late and slow joint the delay may be replaced by a clock that drifts while the wrong limit stands
beside it, and no limit fits beside that clock.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.contenders import Contender, Found, Raced
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.ties import Judged, measured


class Searching(Judged, Protocol):
    """What looks back: a search."""

    def keep(self, found: Found, fit: Fit, error: np.ndarray) -> None:
        """Let a fit with its held-out errors be the best so far."""
        ...

    def joins(self, best: Contender, found: Found, contenders: list[Contender]) -> bool:
        """Return whether an effect's held-out gain is sure, and large enough to matter."""
        ...

    def place_of(self, own: Contender) -> Raced:
        """Return who raced for a member's place, beside the others."""
        ...

    def polish(self, best: Contender) -> Contender:
        """Return the winner fitted on more windows."""
        ...


class Look(NamedTuple):
    """One member's place: who takes it, all who could, and what is left without anybody."""

    member: Candidate
    best: Contender
    contenders: list[Contender]  # the best first
    rest: Raced


def look_back(search: Searching, found: Found) -> None:
    """Exchange or take out members of what was found, until nothing is better.

    Args:
        search: after its forward part; its setting `exchanges` says how many are made at most.
        found: changed in place: its fit, held-out errors (W, T, M) and each member's rivals.
    """
    seen: dict[frozenset[str], Raced] = {}  # races for the place beside these others
    for left in reversed(range(search.settings.exchanges + 1)):
        looks = _looks(search, found, seen)
        changes = [look for look in looks if look.best.candidate is not look.member]
        if not changes or not left:
            found.rivals |= {look.member.label: look.contenders for look in looks}
            return
        change = min(changes, key=lambda look: search.blocks.rms(look.best.error))
        best = search.polish(change.best)
        search.keep(found, best.fit, best.error)
        found.rivals.pop(change.member.label, None)


def _looks(search: Searching, found: Found, seen: dict[frozenset[str], Raced]) -> list[Look]:
    """Return what each member's place came to; who is worth nothing beside the others is out."""
    looks: list[Look] = []
    while len(found.fit.members) > 1 and len(looks) < len(found.fit.members):
        look = _look(search, found, found.fit.members[len(looks)], seen)
        dropped = Found(look.rest.fit, look.rest.error)
        if search.joins(look.contenders[0], dropped, look.contenders):
            looks.append(look)
            continue
        search.keep(found, *look.rest[:2])
        found.rivals.pop(look.member.label, None)
        looks = []
    return looks


def _look(
    search: Searching, found: Found, member: Candidate, seen: dict[frozenset[str], Raced]
) -> Look:
    """Return who could have a member's place."""
    own = Contender(member, found.fit, found.error)  # it has settled
    beside = frozenset(m.label for m in found.fit.members if m is not member)
    if beside not in seen:
        seen[beside] = search.place_of(own)
    rest = seen[beside]
    others = [c for c in rest.contenders if c.candidate.label != member.label]
    contenders = sorted([own, *others], key=lambda c: search.blocks.rms(c.error))
    best = measured(search, own, rest.contenders, rest.error) or contenders[0]
    return Look(member, best, contenders, rest)
