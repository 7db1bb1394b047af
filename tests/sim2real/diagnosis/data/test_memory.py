"""Rows are remembered within a limit."""

import numpy as np

from sim2real.diagnosis.data.memory import Memory


def test_what_was_not_asked_for_the_longest_is_forgotten() -> None:
    """Two rows fit; the one that was asked for last stays."""
    memory, arrays = Memory(2 * 8 * 3), [np.arange(6.0).reshape(3, 2), np.arange(3.0)]
    found = [np.zeros((1, 2)), np.zeros(1)]
    memory.keep("first", arrays, 0)
    memory.keep("second", arrays, 1)
    assert memory.recall("first", found, 0)
    memory.keep("third", arrays, 2)
    assert not memory.recall("second", found, 0)
    assert memory.recall("third", found, 0)
    assert np.array_equal(found[0], [[4.0, 5.0]]) and np.array_equal(found[1], [2.0])


def test_what_is_kept_does_not_change_with_its_source() -> None:
    """A caller may write into its arrays."""
    memory, arrays, found = Memory(1e3), [np.ones((1, 2))], [np.zeros((1, 2))]
    memory.keep("row", arrays, 0)
    arrays[0][:] = 5.0
    assert memory.recall("row", found, 0) and (found[0] == 1.0).all()
