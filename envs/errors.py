"""What a user of the simulated worlds can get wrong, one class a mistake."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class EnvsError(ValueError):
    """Base of every error that a user's input to `envs` can cause."""


class ParameterError(EnvsError):
    """A parameter's name, value, range or place is wrong."""


class EffectError(EnvsError):
    """An effect is unknown, or this robot cannot have it."""


class TaskError(EnvsError):
    """A task, its model or the arguments of a call to it do not fit."""


class RenderError(EnvsError):
    """No picture can be drawn on this machine, or of this environment."""


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """Return " (did you mean 'x'?)" for the nearest of the allowed names, or ""."""
    close = difflib.get_close_matches(name, list(allowed), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""
