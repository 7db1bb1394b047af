"""Errors that a user of the simulated worlds can cause, one class per kind of mistake."""

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


def refuse_unknown(
    name: str, value: object, allowed: Iterable[str], error: type[EnvsError] = EffectError
) -> None:
    """Raise an error for a value that is none of the allowed names, with the nearest of them.

    Args:
        name: of the argument, as it was given.
        value: what was given.
        allowed: the names.
        error: its class.
    """
    if value not in (allowed := list(allowed)):
        hint = did_you_mean(str(value), allowed)
        raise error(f"{name}={value!r} is unknown{hint}; choose one of: {', '.join(allowed)}")


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """Return " (did you mean 'x'?)" for the nearest of the allowed names, or ""."""
    close = difflib.get_close_matches(name, list(allowed), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""
