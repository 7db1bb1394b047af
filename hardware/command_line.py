"""Keys and values of python -m hardware VERB key=value ..., and what is wrong with them.

keys = parse_keys("scan", ["robot=bench1", "port=/dev/ttyUSB0"], {"scan": ("robot", "port")})
number(keys, "seconds", 10.0)
"""

import math
from collections.abc import Mapping, Sequence

from hardware.errors import HardwareError, did_you_mean, format_names

Keys = dict[str, str]


class UsageError(HardwareError):
    """A command line that cannot be meant, or a question that nobody answered."""


def parse_keys(verb: str, words: Sequence[str], allowed: Mapping[str, Sequence[str]]) -> Keys:
    """Return the values by key.

    Args:
        verb: the command.
        words: what stands behind it.
        allowed: the keys of each verb.

    Raises:
        UsageError: a verb or a key that is not there, a key twice.
    """
    if verb not in allowed:
        hint = did_you_mean(verb, allowed)
        raise UsageError(f"unknown command {verb!r}{hint}; available: {format_names(allowed)}")
    keys: Keys = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or key not in allowed[verb]:
            hint = did_you_mean(key, allowed[verb])
            raise UsageError(
                f"{verb} does not accept {word!r}{hint}; it accepts {format_names(allowed[verb])}"
            )
        keys[key] = value
    return keys


def required(keys: Keys, key: str, why: str) -> str:
    """Return the value of a key; raises UsageError if it is not given."""
    if key not in keys:
        raise UsageError(f"{key}= is missing: {why}")
    return keys[key]


def number(keys: Keys, key: str, default: float) -> float:
    """Return a number; raises UsageError if it is none, or not finite."""
    if key not in keys:
        return default
    try:
        value = float(keys[key])
    except ValueError:
        raise UsageError(f"{key}={keys[key]} is not a number") from None
    if not math.isfinite(value):
        raise UsageError(f"{key}={keys[key]} is not a finite number")
    return value


def yes_or_no(keys: Keys, key: str, default: bool) -> bool:
    """Return whether a key is true; raises UsageError if it is neither true nor false."""
    answers = {"true": True, "false": False}
    word = keys.get(key, str(default).lower())
    if word not in answers:
        raise UsageError(f"{key}={word}: expected true or false")
    return answers[word]
