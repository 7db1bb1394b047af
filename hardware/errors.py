"""Errors that a user of the hardware can cause, one class per kind of mistake."""

import difflib
from collections.abc import Iterable


class HardwareError(ValueError):
    """Base of every error that a user's input to `hardware` can cause."""


class LogError(HardwareError):
    """A trajectory log cannot be read or written."""


class RobotError(HardwareError):
    """A robot's file is missing or wrong."""


class SerialPortError(HardwareError):
    """The serial line cannot be used: the cable is out, or the port is not there."""


class ServoError(HardwareError):
    """A servo is missing, has the wrong type, or does not follow its commands."""


class SafetyError(HardwareError):
    """The robot was stopped, or may not move, for the safety of itself and of others."""


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """Return " (did you mean 'x'?)" for the nearest of the allowed names, or ""."""
    close = difflib.get_close_matches(name, list(allowed), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def format_names(names: Iterable[str]) -> str:
    """Return the names as "'a', 'b'", or "none"."""
    return ", ".join(map(repr, names)) or "none"


def format_reason(error: BaseException) -> str:
    """Return why an exception ended something: a HardwareError says it, others are named."""
    name, text = type(error).__name__, str(error)
    return text if isinstance(error, HardwareError) else f"{name}: {text}" if text else name
