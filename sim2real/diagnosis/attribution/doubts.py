"""Why causes may not be what they look like, however well they close a gap.

findings = doubts(fit.members, search.witnessed)
"""

from __future__ import annotations

from collections.abc import Sequence

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.ties import Witnessed
from sim2real.diagnosis.attribution.verdict import imitations, unwitnessed
from sim2real.diagnosis.schema import Finding


def doubts(members: Sequence[Candidate], witnessed: Witnessed) -> list[Finding]:
    """Return what keeps causes from explaining a gap, in words.

    Args:
        members: the causes.
        witnessed: effects that channels measured; see `ties.witnesses`.
    """
    alone = [_claimed(one) for one in unwitnessed(members, witnessed)]
    return alone + [_imitated(*pair) for pair in imitations(members)]


def _claimed(member: Candidate) -> Finding:
    return Finding(
        "unwitnessed",
        member.joint,
        f"{member.name} is read off the motion alone: no other channel of the logs shows it, and "
        "other effects move a robot alike",
        f"check it by itself: {member.effect.experiment}",
    )


def _imitated(one: Candidate, other: Candidate, like: str) -> Finding:
    return Finding(
        "imitation",
        one.joint,
        f"{one.name} and {other.name} together act much like {like}: one law that is missing may "
        "be there in the place of both",
        f"check each by itself: {one.effect.experiment}; {other.effect.experiment}",
    )
