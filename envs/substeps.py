"""The rules that act before each physics substep of a plant, and their rows.

substeps = Substeps(num_rows, physics)
field = substeps.live("dof_frictionloss", field)      # for a rule to change
substeps.use(rules, single)
substeps.place(rule, ids, present)                    # where an effect is not absent
substeps.apply(ids, applied)                          # before a substep of the rows ids
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from envs.effects.bound import SubstepRule
from envs.effects.places import spaced
from envs.physics.arrays import Array
from envs.physics.base import Physics


class Substeps:
    """The substep rules of a plant of N rows, and the model fields that they change.

    Args:
        num_rows: N.
        physics: what steps the rows.
    """

    def __init__(self, num_rows: int, physics: Physics) -> None:
        self.rules: tuple[SubstepRule, ...] = ()
        self._num_rows, self._physics, self._arrays = num_rows, physics, physics.arrays
        self._own: dict[str, np.ndarray] = {}  # live fields of the batch, in which effects write
        # what fields return to before each substep, and what they are now, (N, ...) by name
        self._base: dict[str, Array] = {}
        self._now: dict[str, Array] = {}
        self._present: dict[SubstepRule, np.ndarray] = {}  # where such an effect is, (N,)
        self._due: list[tuple[SubstepRule, Any]] = []  # who acts on some rows
        self._ids: np.ndarray | None = None  # these rows; None: all
        self._known = False  # whether that is so

    def use(self, rules: Sequence[SubstepRule], single: Sequence[SubstepRule]) -> None:
        """Take the rules, in their order.

        Args:
            rules: all of them.
            single: those that are one effect, and rest where it is absent; what several effects
                share always acts.
        """
        self.rules = tuple(rules)
        self._present = {rule: np.ones(self._num_rows, dtype=bool) for rule in single}

    def live(self, name: str, field: np.ndarray) -> np.ndarray:
        """Return a field (N, ...) of the batch that each substep starts from as it is now."""
        if name not in self._own:
            self._own[name] = self._now[name] = field
            self._base[name] = field.copy()
        return field

    def now(self, name: str) -> Array:
        """Return a live field (N, ...) in the engine, while rules are prepared and act."""
        return self._now[name]

    def hold(self, name: str, ids: np.ndarray) -> None:
        """Let a live field's values in the rows ids be those that substeps start from."""
        if name not in self._own:
            return
        if self._arrays.on_host:
            self._base[name][ids] = self._own[name][ids]
        else:
            self._known = False

    def written(self, ids: np.ndarray) -> None:
        """Take note that parameters were written into the rows ids."""
        for name in self._own:
            self.hold(name, ids)
        self._known = False

    def place(self, rule: object, ids: np.ndarray, present: np.ndarray) -> None:
        """Take note in which of the rows ids a rule's effect is present, (n,)."""
        if isinstance(rule, SubstepRule) and rule in self._present:
            self._present[rule][ids] = present

    def apply(self, ids: np.ndarray | None, applied: Array) -> None:
        """Bring live fields and applied forces (N, nv) back, and let the rules act.

        Args:
            ids: the rows of the coming substep, (n,); None for all.
            applied: the forces that rules add to.
        """
        if not self._known or not _same(ids, self._ids):
            self._prepare(ids)
        most = ids is None or 2 * len(ids) > self._num_rows  # copies whole fields rather than rows
        rows = self._arrays.rows(None if most else ids)
        for name, base in self._base.items():
            self._now[name][rows] = base[rows]
        applied[rows] = 0.0
        with np.errstate(all="ignore"):  # a diverged row's numbers are its own affair
            for rule, own in self._due:
                rule.before_substep(own)

    def _prepare(self, ids: np.ndarray | None) -> None:
        """Tell the rules on which rows they act: not on those in which their effect is absent."""
        if not self._arrays.on_host:
            for name, own in self._own.items():
                self._now[name] = self._physics.field(name, own)
                self._base[name] = self._arrays.own(own)
        self._due = []
        for rule in self.rules:
            own: np.ndarray | slice = slice(None) if ids is None else ids.copy()
            present = self._present.get(rule)
            if present is not None and not present[own].all():
                own = np.flatnonzero(present) if ids is None else ids[present[ids]]
                if not own.size:
                    continue
            own = spaced(own)
            rule.prepare(own)
            self._due.append((rule, self._arrays.index(own)))
        self._ids, self._known = None if ids is None else ids.copy(), True


def _same(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    """Return whether two lists of rows are the same."""
    return one is other if one is None or other is None else np.array_equal(one, other)
