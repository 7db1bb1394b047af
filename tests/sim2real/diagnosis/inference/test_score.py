"""Folds that see every regime, and bounds of paired sums."""

from typing import cast

import numpy as np
import pytest

from sim2real.diagnosis.data.windows import Window
from sim2real.diagnosis.inference.score import Bootstrap, deal_folds
from sim2real.diagnosis.settings.inference import Inference


def window(log: int, start: int, lively: float, off: float = 0.0, episode: int = 0) -> Window:
    """Return what dealing asks of a window."""
    none = np.zeros(0)
    rest = (cast(object, None), none, none, none)
    return Window(log, episode, 0, start, start, start + 1, *rest, lively, off)  # type: ignore[arg-type]


def test_each_fold_sees_every_log_with_and_without_torque() -> None:
    """One log of four alone is recorded with the servo off: both folds see it."""
    windows = [
        window(log, 10 * n, n % 5, off=float(log == 2)) for log in range(4) for n in range(8)
    ]
    fold = deal_folds(windows)
    for log in range(4):
        own = fold[[w.log == log for w in windows]]
        assert own.sum() == len(own) / 2
    slow = [w.lively < 2 for w in windows]
    assert fold[slow].mean() == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize("driven", range(14, 18))
def test_each_fold_gets_a_window_without_torque(driven: int) -> None:
    """Two stretches of free swinging are dealt to one fold each, however many others there are."""
    windows = [window(0, n, float(n)) for n in range(driven)]
    windows += [window(0, 90, 0.5, off=0.5), window(0, 91, 30.0, off=0.9)]
    fold = deal_folds(windows)
    assert sorted(fold[driven:]) == [0, 1]
    assert abs(2 * fold.sum() - len(fold)) <= 1


def test_bounds_hold_the_sum_as_often_as_they_say() -> None:
    """Of sums of normal differences with mean zero, five in a hundred lie above each bound."""
    settings, rng = Inference(), np.random.default_rng(0)
    windows = [window(0, n, 1.0) for n in range(60)]
    low = high = 0
    for _ in range(100):
        gain = Bootstrap(windows, rng, settings).gain(rng.normal(size=60))
        low, high = low + (gain.low > 0), high + (gain.high < 0)
    assert 0.01 < low / 100 < 0.13
    assert 0.01 < high / 100 < 0.13


def test_a_difference_in_one_window_is_not_certain() -> None:
    """What one block alone says may be chance, however large."""
    windows = [window(0, n, 1.0) for n in range(40)]
    difference = np.zeros(40)
    difference[7] = 1000.0
    gain = Bootstrap(windows, np.random.default_rng(0), Inference()).gain(difference)
    assert gain.total == 1000.0
    assert gain.low == 0.0
