"""Pieces of work on several cores: what is stepped from Python keeps one core busy at a time.

    first, second, third = together([task, other, another])

Processes are forked for the call and know all that this one knew; who is free takes the next task.
Results are the same in whichever process, if a task depends on nothing that another one changes.
Where processes cannot be forked (not on Linux), and in one that was, all tasks are done in turn.

`concurrent.futures` would do as well, but for three things: it has no processes inside a worker of
`multiprocessing.Pool`, which is daemonic; its own outlive a parent that is killed; and the process
that waits takes no task itself.
"""

import contextlib
import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, Pipe
from typing import Any, TypeVar

T = TypeVar("T")
MOST = 256  # tasks of a call that are shared: a task's number is a byte, which is read whole

_forked = False  # whether this process is a helper
_sharing = False  # whether helpers are at work
_ended: list[int] = []  # helpers that have answered, and give their memory back by themselves


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else 1


def is_helper() -> bool:
    """Return whether this process is a helper: threads of its parent are not there."""
    return _forked


def is_free() -> bool:
    """Return whether tasks would be shared: not where others are being done."""
    return not (_forked or _sharing) and sys.platform == "linux"


def together(tasks: Sequence[Callable[[], T]], hands: int = 0) -> list[T]:
    """Return what tasks return, in their order; an exception of one is raised.

    Args:
        tasks: take no argument, and return what can be pickled.
        hands: processes, this one included; 0 for one a core.
    """
    global _sharing
    count = min(hands or cores(), len(tasks))
    if count < 2 or not is_free() or len(tasks) > MOST:
        return [task() for task in tasks]
    _reap()
    numbers, queue = os.pipe()
    os.write(queue, bytes(range(len(tasks))))
    os.close(queue)
    helpers = [_helper(tasks, numbers) for _ in range(count - 1)]
    done: dict[int, Any] = {}
    _sharing = True
    try:
        done = {number: tasks[number]() for number in _taken(numbers)}
    finally:
        _sharing = False
        os.close(numbers)
        answers = [_receive(*helper) for helper in helpers]
    for results in answers:
        if isinstance(results, Exception):
            raise results
        done |= results
    return [done[n] if n in done else task() for n, task in enumerate(tasks)]


def _taken(numbers: int) -> Iterator[int]:
    """Yield numbers of tasks that nobody else does."""
    while byte := os.read(numbers, 1):
        yield byte[0]


def _helper(tasks: Sequence[Callable[[], Any]], numbers: int) -> tuple[int, Connection]:
    """Fork a process that does tasks; return it and where its results come from.

    No garbage is collected meanwhile: a pool of threads, deleted where its threads are not, waits
    for ever, and a collection may begin in the first lines after a fork, before any of ours.
    """
    here, there = Pipe(duplex=False)
    enabled = gc.isenabled()
    gc.disable()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads: helpers use none
            child = os.fork()
        if child == 0:
            gc.freeze()
    finally:
        if enabled:
            gc.enable()
    if child == 0:
        here.close()
        _work(tasks, numbers, there)
    there.close()
    return child, here


def _work(tasks: Sequence[Callable[[], Any]], numbers: int, answer: Connection) -> None:
    """Do tasks, say what they return and end this process; never returns."""
    global _forked
    _forked = True
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent says when it is over
        try:
            answer.send({number: tasks[number]() for number in _taken(numbers)})
        except Exception as error:
            answer.send(error)
    finally:
        os._exit(0)


def _receive(child: int, answer: Connection) -> Any:
    """Return what a helper says; {} where it was ended: its tasks are then done here."""
    try:
        return answer.recv()
    except EOFError:
        return {}
    finally:
        answer.close()
        _ended.append(child)


def _reap() -> None:
    """Collect helpers that have ended; what a fork of this process inherits is not its own."""
    while _ended:
        with contextlib.suppress(ChildProcessError):
            os.waitpid(_ended.pop(), 0)
