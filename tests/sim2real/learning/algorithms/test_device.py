"""Networks on another device than the simulation's, shown without a GPU: see tests/sim2real/far."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import pytest
import torch

from tests.sim2real.learning.algorithms import test_sac

Learner = Callable[..., Any]
# PPO runs on TorchRL's parts, whose operators that device lacks: the tests marked gpu have it
LEARNERS: dict[str, Learner] = {
    "sac": partial(test_sac.learner, steps=10, warmup_frames=80),
}


@pytest.fixture(scope="module")
def process() -> Iterator[ProcessPoolExecutor]:
    """Return a process in which the second device is registered."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        yield pool


def train_twice(name: str) -> tuple[float, bool, set[str]]:
    """Train on the processor and on the second device.

    Returns:
        How far the parameters are apart after two iterations, whether a loaded state goes on to the
        last bit, and on which devices the parameters are.
    """
    far = importlib.import_module("tests.sim2real.far")
    with far.Apart():
        here, there, again = (LEARNERS[name](device=d) for d in ("cpu", far.NAME, far.NAME))
        for _ in range(2):
            here.iterate()
            there.iterate()
        again.load_state_dict(there.state_dict())
        equal = again.iterate() == there.iterate()
        here.iterate()
        own, others = (list(x.policy.state_dict().values()) for x in (here, there))
        apart = [float((a - b.cpu()).abs().max()) for a, b in zip(own, others, strict=True)]
        return max(apart), equal, {str(x.device.type) for x in others}


def mix() -> list[str]:
    """Add tensors of both devices, and look at one as an array; return what is said."""
    far = importlib.import_module("tests.sim2real.far")
    said = []
    with far.Apart():
        there = torch.ones(3, device=far.NAME)
        for attempt in (lambda: there + torch.ones(3), there.numpy):
            try:
                said.append(str(attempt()))
            except (RuntimeError, TypeError) as error:
                said.append(str(error))
    return said


@pytest.mark.parametrize("name", LEARNERS)
def test_learning_on_another_device_equals_that_on_the_processor(
    name: str, process: ProcessPoolExecutor
) -> None:
    """No operation mixes devices, the networks stay there, and a loaded state goes on there."""
    apart, equal, devices = process.submit(train_twice, name).result()
    assert apart < 1e-5
    assert equal
    assert devices == {"far"}


def test_the_second_device_does_not_mix_with_the_first(process: ProcessPoolExecutor) -> None:
    """What the tests above would raise."""
    added, read = process.submit(mix).result()
    assert added == "aten::add: tensors on both devices"
    assert "numpy" in read
