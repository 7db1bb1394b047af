"""The log of an episode: numbered on, complete, and silent about what never was."""

import sys
from collections.abc import Callable
from itertools import count

import numpy as np
import pytest

import hardware.episode_log
import hardware.log_writer
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.episode_log import EpisodeLog
from hardware.log import read_log, read_logs
from hardware.safety import Sent


@pytest.fixture(scope="module")
def measured():
    """Some measurements of the bench, as an episode gives them."""
    backend = ServoBackend(load_robot("bench1"), settle=0.1)
    found = [backend.start(np.zeros(1))]
    for _ in range(3):
        backend.command(np.full(1, 0.1))
        found.append(backend.wait())
    backend.close()
    return found


def written(log: EpisodeLog, measured, steps: int) -> None:
    """Write an episode of some steps."""
    log.begin(measured[0])
    for k in range(steps):
        sent = Sent(np.full(1, 0.1), ("limit",) if k == 1 else ("",))
        log.add(0.02 * k + 0.001, np.array([0.5]), np.full(1, 0.2), sent, [None], {})
        log.outcome(float(k), late=k == 2)
        log.follow(measured[k + 1])


def test_rows_are_commands_and_the_last_is_what_they_led_to(measured, tmp_path):
    """What was asked, sent and earned stands beside what was measured before it."""
    log = EpisodeLog(load_robot("bench1"), tmp_path)
    written(log, measured, 3)
    whole = log.finish({"task": "Bench1"})
    assert whole is not None
    assert len(whole) == 4
    assert whole.column("reward").tolist() == [0.0, 1.0, 2.0, 0.0]
    assert whole.column("flag.late").tolist() == [0.0, 0.0, 1.0, 0.0]
    assert whole.column("flag.limited").tolist() == [0.0, 1.0, 0.0, 0.0]
    assert whole.column("flag.end").tolist() == [0.0, 0.0, 0.0, 1.0]
    assert set(whole.column("ctrl.hinge")) == {0.1}
    assert set(whole.column("action.hinge")) == {0.2}
    position = [m.reading.position[0] for m in measured]
    np.testing.assert_array_equal(whole.column("qpos.hinge"), position)
    assert not any(name.startswith("voltage") for name in whole.columns)
    assert whole.meta["task"] == "Bench1"


def test_files_are_numbered_on_and_nothing_leaves_none(measured, tmp_path):
    """A second log of the folder goes on behind the first; an episode of no step has no file."""
    first = EpisodeLog(load_robot("bench1"), tmp_path)
    written(first, measured, 2)
    first.finish({})
    first.begin(measured[0])
    assert first.finish({}) is None
    assert first.finish({}) is None
    second = EpisodeLog(load_robot("bench1"), tmp_path)
    written(second, measured, 3)
    second.stopped()
    second.finish({})
    logs = read_logs(tmp_path)
    assert [set(log.episode) for log in logs] == [{0}, {1}]
    assert logs[1].column("flag.stopped").sum() > 0


FILES = (hardware.episode_log.__file__, hardware.log_writer.__file__)


def interrupted(action: Callable[[], object], place: int) -> bool:
    """Raise KeyboardInterrupt at so many lines and returns of the two files; False: it got by."""
    left, before = place, sys.gettrace()

    def trace(frame, event, _):
        nonlocal left
        if frame.f_code.co_filename not in FILES:
            return None
        left -= event in ("line", "return")
        if left < 0:
            raise KeyboardInterrupt
        return trace

    sys.settrace(trace)
    try:
        action()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def test_an_interruption_anywhere_leaves_every_row_once(measured, tmp_path):
    """Wherever Ctrl-C comes, the log that is closed then is whole, and as it is in memory."""
    log, whole = EpisodeLog(load_robot("bench1"), tmp_path), np.array([0.001, 0.021])

    def episode() -> None:
        written(log, measured, 2)
        log.finish({"stopped": None})

    before: set[str] = set()
    for place in count():
        log.last = None
        broken = interrupted(episode, place)
        log.finish({"stopped": "Ctrl-C"})
        added = {path.name for path in tmp_path.iterdir()} - before
        before |= added
        assert len(added) == (0 if log.last is None else 2)
        if log.last is not None:
            found = read_log(tmp_path / min(added))
            np.testing.assert_array_equal(found.time, log.last.time)
            sent = found.time[found.column("flag.end") == 0]
            np.testing.assert_array_equal(sent, whole[: len(sent)])
        if not broken:
            break
    assert place > 100
