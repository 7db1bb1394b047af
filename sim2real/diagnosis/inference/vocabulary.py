"""What an explanation may be made of: every change of the robot, of its log and of the world.

    vocabulary = Vocabulary(about)
    vocabulary.list_starts(error, joints)   # each change by itself, and where its fit begins

Where a change lies among few values that a fit can reach only from nearby, such as the count of a
ripple, the errors say where to begin, so that the starts depend on them.
"""

from collections.abc import Collection, Sequence

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.candidates import Candidate, candidates
from sim2real.diagnosis.inference.cogging import with_ripples
from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.hypotheses import Member
from sim2real.diagnosis.inference.log_change import LogChange
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.moves import make_start
from sim2real.diagnosis.inference.world_changes import list_world_changes

RIPPLE = "cogging"


def list_effects(data: Data, fixed: Sequence[Fixed] = ()) -> list[Candidate]:
    """Return what may differ of the robot and its world, each label once."""
    found = candidates(data, fixed)
    known = {member.label for member in found}
    return found + [member for member in list_world_changes(data) if member.label not in known]


class Vocabulary:
    """The changes that a robot, its logs and its world can have.

    Args:
        data: the windows.
        exclude: names of effects that explain nothing; that one would do as well counts against
            an explanation.
        fixed: effects that are in the model already.
        log: whether the log may be wrong; not where windows start from an estimate made of it.
        robot: whether the robot and its world may be other than the model.
        only: labels of the changes that are looked at; None: all.
    """

    def __init__(
        self,
        data: Data,
        exclude: Sequence[str] = (),
        fixed: Sequence[Fixed] = (),
        *,
        log: bool = True,
        robot: bool = True,
        only: Collection[str] | None = None,
    ) -> None:
        self.data, self.robot = data, robot
        every = list_effects(data, fixed) if robot else []
        self.effects = [member for member in every if member.name not in exclude]
        self.excluded = [member for member in every if member.name in exclude]
        known = {member.label for member in self.effects}
        changes = list_log_changes(data) if log else []
        changes = [c for c in changes if c.effect is None or c.label in known]
        undone = {change.label for change in changes}
        found: list[Member] = [*changes]
        found += [member for member in self.effects if member.label not in undone]
        self.choices = max(len(found), 1)  # that a change is one of
        self.members = [one for one in found if only is None or one.law in only]
        self.shown = [one for one in self.members if isinstance(one, LogChange) and one.shown]

    def list_starts(self, errors: np.ndarray, joints: Collection[str]) -> list[Start]:
        """Return each change by itself that some joints can show, and where its fit begins.

        Errors, simulated minus measured, (W, T, M), are those with what is known.
        """
        shown = [m for m in self.members if not m.joints or {*m.joints} & {*joints}]
        return self._start(shown, errors)

    def list_excluded(self, errors: np.ndarray) -> list[Start]:
        """Return the same of every effect that is excluded."""
        return self._start(self.excluded, errors)

    def _start(self, members: Sequence[Member], errors: np.ndarray) -> list[Start]:
        return [make_start(self._tuned(member, errors)) for member in members]

    def _tuned(self, member: Member, errors: np.ndarray) -> Member:
        """Return a change whose probes are what the errors show, where they show it."""
        if isinstance(member, Candidate) and member.name == RIPPLE:
            return with_ripples(member, self.data, errors)
        return member
