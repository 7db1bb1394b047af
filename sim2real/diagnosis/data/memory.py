"""Rows of simulations that were made before, as many as a limit of memory allows.

memory = Memory(2e8)
memory.keep(name, result, row)
memory.recall(name, result, row)            # True: the row is filled in
"""

from collections import OrderedDict
from collections.abc import Hashable, Sequence

import numpy as np


class Memory:
    """Rows of arrays by name; those that were not asked for the longest are forgotten first.

    Args:
        most: bytes that the rows may take.
    """

    def __init__(self, most: float) -> None:
        self._most, self._size = most, 0
        self._rows: OrderedDict[Hashable, tuple[np.ndarray, ...]] = OrderedDict()

    def recall(self, name: Hashable, arrays: Sequence[np.ndarray], row: int) -> bool:
        """Put what is known of a name into a row of each array; return whether it is known."""
        known = self._rows.get(name)
        if known is None:
            return False
        self._rows.move_to_end(name)
        for array, own in zip(arrays, known, strict=True):
            array[row] = own
        return True

    def keep(self, name: Hashable, arrays: Sequence[np.ndarray], row: int) -> None:
        """Keep a row of each array under a name."""
        if name in self._rows:
            return
        own = tuple(np.array(array[row]) for array in arrays)
        self._rows[name] = own
        self._size += sum(part.nbytes for part in own)
        while self._size > self._most:
            _, old = self._rows.popitem(last=False)
            self._size -= sum(part.nbytes for part in old)
