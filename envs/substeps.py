"""What acts before each physics substep of a plant, and in which rows.

substeps = Substeps(num_rows)
field = substeps.live("dof_frictionloss", field)      # for a rule to change
substeps.use(rules, single)
substeps.place(rule, ids, present)                    # where an effect is not absent
substeps.act(ids, applied)                            # before a substep of the rows ids
"""

from collections.abc import Sequence

import numpy as np

from envs.effects.bound import SubstepRule
from envs.effects.places import spaced


class Substeps:
    """The substep rules of a plant of N rows, and the model fields that they change.

    Args:
        num_rows: N.
    """

    def __init__(self, num_rows: int) -> None:
        self.rules: tuple[SubstepRule, ...] = ()
        self._num_rows = num_rows
        # what fields return to before each substep, and what they are now, (N, ...) by name
        self._base: dict[str, np.ndarray] = {}
        self._now: dict[str, np.ndarray] = {}
        self._present: dict[SubstepRule, np.ndarray] = {}  # where such an effect is, (N,)
        self._due: list[tuple[SubstepRule, np.ndarray | slice]] = []  # who acts on some rows
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
        """Return a field (N, ...) that each substep starts from as it is now."""
        if name not in self._base:
            self._base[name], self._now[name] = field.copy(), field
        return field

    def hold(self, name: str, ids: np.ndarray) -> None:
        """Let a live field's present values in the rows ids be those that substeps start from."""
        if name in self._base:
            self._base[name][ids] = self._now[name][ids]

    def written(self, ids: np.ndarray) -> None:
        """Take note that parameters were written into the rows ids."""
        for name in self._base:
            self.hold(name, ids)
        self._known = False

    def place(self, rule: object, ids: np.ndarray, present: np.ndarray) -> None:
        """Take note in which of the rows ids a rule's effect is present, (n,)."""
        if isinstance(rule, SubstepRule) and rule in self._present:
            self._present[rule][ids] = present

    def apply(self, ids: np.ndarray | None, applied: np.ndarray) -> None:
        """Bring live fields and applied forces (N, nv) back, and let the rules act.

        Args:
            ids: the rows of the coming substep, (n,); None for all.
            applied: the forces that rules add to.
        """
        if not self._known or not _same(ids, self._ids):
            self._prepare(ids)
        most = ids is None or 2 * len(ids) > self._num_rows  # copies whole fields rather than rows
        rows: np.ndarray | slice = slice(None) if ids is None or most else ids
        for name, base in self._base.items():
            self._now[name][rows] = base[rows]
        applied[rows] = 0.0
        with np.errstate(all="ignore"):  # a diverged row's numbers are its own affair
            for rule, own in self._due:
                rule.before_substep(own)

    def _prepare(self, ids: np.ndarray | None) -> None:
        """Tell the rules on which rows they act: not on those in which their effect is absent."""
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
            self._due.append((rule, own))
        self._ids, self._known = None if ids is None else ids.copy(), True


def _same(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    """Return whether two lists of rows are the same."""
    return one is other if one is None or other is None else np.array_equal(one, other)
