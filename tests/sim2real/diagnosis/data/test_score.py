"""Gains with intervals: what hangs together is drawn together, and a winner pays for its race."""

import numpy as np
import pytest

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.score import Blocks, coherence
from tests.sim2real.diagnosis import arm

SECONDS = 64.0


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Data:
    """A minute of one recording."""
    return arm.data_of(arm.make_log(seconds=SECONDS), tmp_path_factory.mktemp("score"))


def rows_of(data: Data, values: np.ndarray) -> np.ndarray:
    """Return errors (W, T, 2) that follow a series, (T,) at 50 Hz, on the compared rows."""
    found = np.zeros((*data.mask.shape, 2))
    for k, (mask, time) in enumerate(zip(data.mask, data.times(), strict=True)):
        own = values[np.round(time * arm.RATE).astype(int)]
        found[k, : len(time)] = np.where(mask[: len(time), None], own[:, None], 0.0)
    return found


def test_residues_that_hang_together_are_drawn_together(data: Data) -> None:
    """White noise needs no long blocks; an error that swells for seconds does, within limits."""
    rng = np.random.default_rng(0)
    count = round(SECONDS * arm.RATE) + 1
    white = coherence(data, rows_of(data, rng.normal(size=count)))
    slow = np.interp(np.arange(count), np.arange(0, count, 100), rng.normal(size=count // 100 + 1))
    long = coherence(data, rows_of(data, slow))
    assert white < 0.6
    assert 1.2 < long <= SECONDS / data.settings.windows.windows_min
    short, wide = (Blocks(data, np.random.default_rng(0), seconds) for seconds in (white, long))
    assert wide.count < short.count
    assert data.settings.windows.windows_min - 2 <= wide.count


def test_a_block_may_span_windows(data: Data) -> None:
    """Rows of one stretch of time are in one block, whichever window they are in."""
    numbers = data.blocks(8.0)
    assert len(np.unique(numbers[data.mask])) == 8
    times = np.concatenate([t[m[: len(t)]] for t, m in zip(data.times(), data.mask, strict=True)])
    for block in np.unique(numbers[data.mask]):
        own = times[numbers[data.mask] == block]
        assert np.ptp(own // 8.0) == 0
    assert (numbers[~data.mask] == -1).all()
