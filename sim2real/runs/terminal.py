"""Colours of the terminal, and pages that are opened in the browser.

sys.stdout.write(format_verdict(report, coloured=has_colours(sys.stdout)))
open_page(Path("outputs/.../report.html"))
"""

import os
import webbrowser
from pathlib import Path
from typing import TextIO

from envs.errors import did_you_mean
from sim2real.runs.errors import Sim2RealError

PAGES = (".html", ".htm")


def has_colours(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that shows colours; NO_COLOR (no-color.org) says no."""
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return not plain and stream.isatty()


def is_page(path: str) -> bool:
    """Return whether an argument is the path of a page, by its name."""
    return Path(path).suffix.lower() in PAGES and ("=" not in path or Path(path).is_file())


def open_page(path: str | Path) -> str:
    """Open a page in the default browser, as a file: nothing is served.

    Returns:
        A sentence with the page's address.

    Raises:
        Sim2RealError: the page does not exist.
    """
    page = Path(path).expanduser()
    if not page.is_file():
        near = [one.name for one in page.parent.glob("*")] if page.parent.is_dir() else []
        raise Sim2RealError(f"no page {page}{did_you_mean(page.name, near)}")
    address = page.resolve().as_uri()
    if webbrowser.open(address):
        return f"opened {address}"
    return f"no browser could be started; open {address}"
