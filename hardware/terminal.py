"""Questions to the person at the terminal, while something else goes on.

    ask_terminal("move hinge to its zero, then press Enter ", meanwhile=driver.read)

`Ask` is what the verbs of `python -m hardware` take; tests answer in its place.
"""

import os
import select
import sys
from collections.abc import Callable
from typing import Protocol

Tell = Callable[[str], None]  # shows a line
PAUSE = 0.02  # s between two looks at what goes on meanwhile


class Ask(Protocol):
    """Asks a question and returns the answer; EOFError: there is no terminal."""

    def __call__(self, prompt: str, meanwhile: Callable[[], object] | None = None) -> str:
        """Ask; call `meanwhile` again and again until the answer comes."""
        ...


def ask_terminal(prompt: str, meanwhile: Callable[[], object] | None = None) -> str:
    """Print a question and return the line that is typed; see `Ask`."""
    if sys.platform == "win32":  # select() takes no terminal there
        return input(prompt)
    sys.stdout.write(prompt)
    sys.stdout.flush()
    line = bytearray()
    while not line.endswith(b"\n"):
        while meanwhile is not None and not select.select([0], [], [], PAUSE)[0]:
            meanwhile()
        byte = os.read(0, 1)
        if not byte:
            raise EOFError
        line += byte
    return line.decode(errors="replace").rstrip("\n")
