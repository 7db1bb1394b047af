"""The engine is silent in a block, in however many threads, and as loud as before after it."""

from __future__ import annotations

import threading

from mujoco import MjLogConfig

from envs.quiet import quiet_engine


def test_blocks_of_several_threads_overlap() -> None:
    """A block that ends does not wake the engine while another thread's block still runs."""
    before = MjLogConfig.get().logto_file
    inside, leave = threading.Event(), threading.Event()

    def other() -> None:
        with quiet_engine():
            inside.set()
            leave.wait(10)

    thread = threading.Thread(target=other)
    with quiet_engine():
        thread.start()
        assert inside.wait(10)
    assert not MjLogConfig.get().logto_file
    leave.set()
    thread.join()
    assert MjLogConfig.get().logto_file == before
