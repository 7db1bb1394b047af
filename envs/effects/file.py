"""`effects.yaml`: what a diagnosis found, in a form that every simulator takes.

    write_effects("effects.yaml", [(make("backlash", where="elbow", side="motor"), (0.049,))])
    plant = Plant(spec, fixed=load_effects("effects.yaml"))

The file is a list of entries with the keys below. Values are in the effect's first way (see
`docs/reference/effects/index.md`):

    - effect: backlash
      where: elbow          # null: the whole robot, or every place that can have it
      side: motor           # motor, link or null
      value: 0.049          # a list where the effect has several values (gravity_tilt)
      ci: [0.045, 0.053]    # interval of the value, or null
      unit: rad
      extra: {}             # the effect's further scalars and options

A `distribution.yaml` (see `envs.distribution_file`) is taken as well: its means.
"""

import math
import os
import re
import secrets
from collections.abc import Sequence
from pathlib import Path
from reprlib import Repr
from typing import Any

import yaml

from envs.effects.base import Effect
from envs.effects.registry import make
from envs.errors import EffectError, did_you_mean

FILE = "effects.yaml"  # in the folder of a diagnosis
KEYS = ("effect", "where", "side", "value", "ci", "unit", "extra")
LAW_KEYS = ("law", "mean", "std", "low", "high", "spread", "uncertainty")  # of a distribution's
ENTRIES = "entries"  # the key of a distribution under which its entries are
EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")  # YAML takes 1e-3 for text
Values = tuple[float, ...]
_REPR = Repr()
_REPR.maxlevel = 2  # nested aliases of YAML stand for lists of any size
short = _REPR.repr


def load_effects(path: str | os.PathLike[str]) -> list[tuple[Effect, Values]]:
    """Return the effects of a file with their values, for the argument `fixed` of a plant.

    A folder is that of a diagnosis, which holds an `effects.yaml`. Places are checked by the plant,
    which knows the robot.

    Raises:
        EffectError: a file that is missing or no such list; an unknown key, effect, side or extra
            (with the nearest); a value that is not a finite number, or in another unit. Each names
            file and entry.
    """
    path = Path(path, FILE) if Path(path).is_dir() else path
    try:
        entries = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise EffectError(f"cannot read the effects file {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise EffectError(f"{path} is not YAML: {error}") from None
    if entries is None:
        return []
    if isinstance(entries, dict) and isinstance(entries.get(ENTRIES), list):
        entries = [_mean(entry) for entry in entries[ENTRIES]]
    if not isinstance(entries, list):
        raise EffectError(f"{path} must be a list of effects, each with the keys {', '.join(KEYS)}")
    found = []
    for number, entry in enumerate(entries, 1):
        try:
            found.append(parse_entry(entry))
        except EffectError as error:
            raise EffectError(f"{path}, entry {number}: {error}") from None
    return found


def _mean(entry: Any) -> Any:
    """Return an entry of a distribution as one of its mean."""
    if not isinstance(entry, dict):
        return entry
    own = {key: value for key, value in entry.items() if key not in LAW_KEYS}
    return {**own, "value": entry.get("mean", entry.get("value"))}


def parse_entry(entry: Any) -> tuple[Effect, Values]:
    """Return the effect and the values of one entry; raises EffectError, see `load_effects`."""
    if not isinstance(entry, dict):
        raise EffectError(f"{short(entry)} is not a mapping with the keys {', '.join(KEYS)}")
    for key in entry:
        if key not in KEYS:
            hint = did_you_mean(str(key), KEYS)
            raise EffectError(f"unknown key {short(key)}{hint}; choose one of: {', '.join(KEYS)}")
    for key in ("effect", "value"):
        if entry.get(key) is None:
            raise EffectError(f"the key {key!r} is missing; add it")
    effect = _effect(entry)
    if entry.get("unit") not in (None, effect.unit):
        raise EffectError(
            f"{effect.label()}: expected the unit {effect.unit!r}, got {short(entry['unit'])};"
            " convert the value"
        )
    given = entry["value"] if isinstance(entry["value"], list) else [entry["value"]]
    return effect, tuple(_number(value, effect.label()) for value in given)


def _effect(entry: dict[str, Any]) -> Effect:
    extra = entry.get("extra") or {}
    name = entry["effect"]
    if (
        not isinstance(name, str)
        or not isinstance(extra, dict)
        or not all(isinstance(k, str) for k in extra)
    ):
        raise EffectError(
            f"effect={short(name)} must be a name and extra={short(extra)} a mapping of names"
        )
    if not isinstance(entry.get("where"), str | None):
        raise EffectError(f"{name}: where={short(entry['where'])} must be a name or null")
    side = {} if entry.get("side") is None else {"side": entry["side"]}
    try:
        return make(name, where=entry.get("where"), **side, **extra)
    except TypeError as error:
        raise EffectError(f"{name}: {error}; look at its extras") from None


def _number(value: Any, label: str) -> float:
    if isinstance(value, str) and EXPONENT.fullmatch(value):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise EffectError(f"{label}: value={short(value)} must be a finite number")
    return float(value)


def write_effects(
    path: str | os.PathLike[str],
    effects: Sequence[tuple[Effect, Sequence[float]]],
    intervals: Sequence[tuple[float, float] | None] | None = None,
) -> None:
    """Write effects with the values of their parameters atomically.

    Args:
        path: the file.
        effects: each with one value a parameter: its own, then those of its free extras.
        intervals: the intervals of each effect's first value.

    Raises:
        EffectError: a value that is not a finite number.
        OSError: the file cannot be written; a former one is then untouched.
    """
    intervals = intervals or [None] * len(effects)
    entries = [
        entry_of(effect, values, ci)
        for (effect, values), ci in zip(effects, intervals, strict=True)
    ]
    text = yaml.safe_dump(entries, sort_keys=False, allow_unicode=True)
    temporary = Path(path).with_name(f".{Path(path).stem}-{secrets.token_hex(8)}.yaml")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def entry_of(effect: Effect, values: Sequence[float], ci: Sequence[float] | None) -> dict[str, Any]:
    """Return one entry of the file; raises EffectError for a value that is not a finite number."""
    numbers = [_number(float(value), effect.label()) for value in values]
    own = numbers[: len(numbers) - len(effect.free)]
    free = dict(
        zip(
            [e.name for e in effect.extras if e.name in effect.free],
            numbers[len(own) :],
            strict=True,
        )
    )
    extra: dict[str, Any] = {**effect.extra, **effect.options(), **free}
    if effect.how != effect.hows[0]:
        extra["how"] = effect.how
    return {
        "effect": effect.name,
        "where": effect.where,
        "side": effect.side,
        "value": own[0] if len(own) == 1 else own,
        "ci": None if ci is None else [float(end) for end in ci],
        "unit": effect.unit,
        "extra": extra,
    }
