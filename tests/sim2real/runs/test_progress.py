"""What a person sees of a job, in a terminal and elsewhere."""

import io
import logging

from sim2real.runs.progress import Progress, format_duration


def test_progress_without_a_terminal_is_a_line_now_and_then(caplog) -> None:
    """The line has iterations, return, speed and the time left; it is not written every time."""
    with (
        caplog.at_level(logging.INFO),
        Progress(100, "iteration", stream=io.StringIO()) as progress,
    ):
        for i in range(1, 101):
            progress.update(i, 1000 * i, 5.0)
    (line,) = caplog.messages
    assert line.startswith("iteration 100/100, return 5.0, ") and line.endswith(
        " steps/s, 0:00 left"
    )


def test_progress_in_a_terminal_is_a_bar() -> None:
    """It shows the newest return and speed, and starts where a resumed run does."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    with Progress(10, "iteration", done=4, stream=terminal) as progress:
        progress.update(10, 3000, 7.25)
    assert "4/10" in terminal.getvalue()
    assert "10/10" in terminal.getvalue().split("\r")[-1] and "return 7.2" in terminal.getvalue()


def test_durations_read_as_clocks() -> None:
    """Hours appear when there are any."""
    assert [format_duration(s) for s in (5, 125, 3725)] == ["0:05", "2:05", "1:02:05"]
