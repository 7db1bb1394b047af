"""What the tests of pages share."""

import shutil

import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chromium-headless-shell")


@pytest.fixture
def browser() -> str:
    """Return a Chromium; skips where there is none."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser to look with; one of {', '.join(BROWSERS)} would do")
    return found
