"""Questions at a terminal, while something else goes on."""

import os

import pytest

from hardware.terminal import ask_terminal


@pytest.fixture
def typed():
    """Return a function that types bytes where the program reads."""
    read, write = os.pipe()
    kept = os.dup(0)
    os.dup2(read, 0)
    yield lambda data: os.write(write, data) if data else os.close(write)
    os.dup2(kept, 0)
    for each in (kept, read):
        os.close(each)


def test_meanwhile_goes_on_until_the_answer(typed, capsys):
    """What is to be done meanwhile is done again and again; two lines typed at once are two."""
    calls = []

    def meanwhile() -> None:
        calls.append(0)
        if len(calls) == 3:
            typed(b"yes\nno\n")

    assert ask_terminal("well? ", meanwhile) == "yes"
    assert len(calls) == 3
    assert ask_terminal("again? ") == "no"
    assert capsys.readouterr().out == "well? again? "


def test_nobody(typed):
    """Where the input ends there is nobody to ask."""
    typed(b"")
    with pytest.raises(EOFError):
        ask_terminal("well? ", lambda: None)
