"""Gains with intervals: what hangs together is drawn together, and a winner pays for its race."""

from __future__ import annotations

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
    assert 1.2 < long <= SECONDS / data.settings.bootstrap.blocks_min
    short, wide = (
        Blocks(data, np.arange(len(data.windows)), np.random.default_rng(0), seconds)
        for seconds in (None, long)
    )
    assert wide.count < short.count
    assert data.settings.bootstrap.blocks_min - 2 <= wide.count


def test_a_block_may_span_windows(data: Data) -> None:
    """Rows of one stretch of time are in one block, whichever window they are in."""
    numbers = data.blocks(8.0)
    assert len(np.unique(numbers[data.mask])) == 8
    times = np.concatenate([t[m[: len(t)]] for t, m in zip(data.times(), data.mask, strict=True)])
    for block in np.unique(numbers[data.mask]):
        own = times[numbers[data.mask] == block]
        assert np.ptp(own // 8.0) == 0
    assert (numbers[~data.mask] == -1).all()


def test_the_winner_of_a_race_pays_for_it(data: Data) -> None:
    """The best of thirty that do nothing looks sure alone; among them it is not."""
    rng = np.random.default_rng(3)
    blocks = Blocks(data, np.arange(len(data.windows)), rng)
    base = np.where(data.mask[..., None], 1.0, 0.0) * np.ones(2)
    noise = 0.2 * rng.normal(size=(30, blocks.count))

    def moved(change: np.ndarray) -> np.ndarray:
        error = base.copy()
        error[blocks.inside] *= np.sqrt(np.maximum(1 + change, 0))[blocks.numbers][:, None]
        return error

    lucky = sorted(map(moved, noise), key=blocks.rms)
    assert blocks.gain(base, lucky[0])[0] > 0
    assert blocks.best_gain(base, lucky) < 0
    assert blocks.best_gain(base, lucky[:1]) == pytest.approx(blocks.gain(base, lucky[0])[0])
    good = moved(noise[0] - 0.3)
    assert blocks.best_gain(base, [good, *lucky]) > 0


def test_a_winner_that_mends_a_few_moments_is_sure_among_rivals(data: Data) -> None:
    """A gap that a few blocks hold, and that is gone with the winner, is no luck of the draw."""
    rng = np.random.default_rng(4)
    blocks = Blocks(data, np.arange(len(data.windows)), rng)
    size = np.full(blocks.count, 0.001)
    size[:3] = 1.0

    def sized(squares: np.ndarray) -> np.ndarray:
        error = np.zeros((*data.mask.shape, 2))
        error[blocks.inside] = np.sqrt(squares)[blocks.numbers][:, None]
        return error

    base, cured = sized(size), sized(np.full(blocks.count, 0.0005))
    rivals = [sized(size * np.exp(0.1 * rng.normal(size=blocks.count))) for _ in range(3)]
    assert blocks.best_gain(base, [cured, *rivals]) > 0
