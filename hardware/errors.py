"""What a user of the hardware can get wrong, one class a mistake."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class HardwareError(ValueError):
    """Base of every error that a user's input to `hardware` can cause."""


class LogError(HardwareError):
    """A trajectory log cannot be read or written."""


class RobotError(HardwareError):
    """A robot's file is missing or wrong."""


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """Return " (did you mean 'x'?)" for the nearest of the allowed names, or ""."""
    close = difflib.get_close_matches(name, list(allowed), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def listed(names: Iterable[str]) -> str:
    """Return the names as "'a', 'b'", or "none"."""
    return ", ".join(map(repr, names)) or "none"
