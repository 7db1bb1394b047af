"""Work on several cores returns what it returns on one."""

import gc
import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.together import is_helper, together
from sim2real.diagnosis.inference.batches import Rows, simulate_each
from sim2real.diagnosis.inference.candidates import candidates
from tests.sim2real.diagnosis import arm

forks = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux alone")


def slowly(number: int) -> tuple[int, int]:
    """Return a number and the process that says it, after some time."""
    time.sleep(0.05)
    return number, os.getpid()


@forks
def test_results_stand_in_the_order_of_the_tasks_and_come_from_several_processes() -> None:
    """Whoever is free takes the next task."""
    found = together([partial(slowly, number) for number in range(6)], hands=2)
    assert [number for number, _ in found] == list(range(6))
    assert len({process for _, process in found}) == 2
    assert not is_helper()


def test_one_hand_does_all_itself() -> None:
    """Nothing is forked then."""
    found = together([partial(slowly, number) for number in range(3)], hands=1)
    assert found == [(number, os.getpid()) for number in range(3)]


@forks
def test_what_goes_wrong_in_a_helper_goes_wrong_here() -> None:
    """Its exception is raised, whoever did the task; later calls are not disturbed."""

    def fail() -> None:
        time.sleep(0.05)
        raise ValueError("the task's own")

    with pytest.raises(ValueError, match="the task's own"):
        together([fail, fail, fail], hands=2)
    assert together([lambda: 1, lambda: 2], hands=2) == [1, 2]


@forks
def test_what_a_helper_that_is_ended_leaves_is_done_here() -> None:
    """Nothing is lost where the system ends a process."""
    here = os.getpid()

    def end() -> int:
        time.sleep(0.05)
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return 1

    assert together([end, end, end, end], hands=2) == [1, 1, 1, 1]


@forks
def test_simulations_are_the_same_to_the_bit(tmp_path: Path) -> None:
    """Rows do not notice in which process they are made; the steps are all counted."""
    data = arm.data_of(arm.make_log(("coulomb_friction", {"where": "a"}, 0.1)), tmp_path)
    options = {option.label: option for option in candidates(data)}
    names = ("stribeck_friction.a", "coulomb_friction.a", "backlash.a (link side)")
    windows, found = np.arange(2), []
    for hands in (1, 2):
        simulator = Simulator(data, threads=hands)
        sets = [
            Rows((options[name],), windows, np.tile(options[name].probes[0], (2, 1)))
            for name in names
        ]
        several = simulate_each(simulator, sets)
        rows = np.tile(windows, 60)
        values = np.linspace(0.01, 0.1, len(rows))[:, None]
        values = np.concatenate([values, np.tile(options[names[0]].probes[0, 1:], (120, 1))], 1)
        many = simulator.run((options[names[0]].effect,), rows, values)
        found.append((several, many, simulator.work.steps))
    (one, few, steps), (other, shared, counted) = found
    for left, right in zip(one, other, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(left, right, strict=True))
    assert all(np.array_equal(a, b) for a, b in zip(few, shared, strict=True))
    assert steps == counted


class Cycle:
    """Garbage that only a collection finds; it says in which process that was."""

    def __init__(self, deleted: int) -> None:
        self.own, self.deleted = self, deleted

    def __del__(self) -> None:
        os.write(self.deleted, b"parent" if os.getpid() == PARENT else b"helper")


PARENT = os.getpid()
littering = False  # whether a forked process allocates much at once


def litter() -> None:
    """Allocate so much that a collection is due."""
    if littering:
        assert len([[] for _ in range(30_000)]) == 30_000


if sys.platform == "linux":
    os.register_at_fork(after_in_child=litter)


@forks
def test_a_helper_deletes_nothing_of_its_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even in the first moment after the fork: a thread pool's end would wait for ever."""
    monkeypatch.setitem(globals(), "littering", True)
    seen, deleted = os.pipe()
    before = gc.get_threshold()
    gc.collect()
    gc.set_threshold(10_000, 1, 1)
    try:
        Cycle(deleted)
        assert together([lambda: 1, lambda: 2], hands=2) == [1, 2]
    finally:
        gc.set_threshold(*before)
    gc.collect()
    os.close(deleted)
    assert os.read(seen, 100) == b"parent"
    os.close(seen)
