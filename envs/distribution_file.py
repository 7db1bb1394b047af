"""`distribution.yaml`: how a robot's parameters are distributed, in a form that training takes.

    write("distribution.yaml", found)
    found = read("distribution.yaml")

The file is a mapping with the keys below. An entry has the keys of `effects.yaml`, of which `value`
is the mean, and the law of its values (lists where an effect has several parameters):

    entries:
    - effect: coulomb_friction
      where: elbow
      side: null
      value: 0.021          # the mean, which effects=distribution.yaml takes
      ci: [0.019, 0.023]    # 90 % interval of the mean, or null
      unit: N·m
      extra: {}
      law: normal           # normal, uniform, lognormal or particles
      mean: 0.021
      std: 0.004            # of a draw: spread and uncertainty together
      low: 0.0              # no draw is below
      high: 0.2             # or above
      spread: 0.0038        # standard deviation between episodes; null: not known
      uncertainty: 0.0012   # standard deviation of the estimate; null: not known
    joint: null             # correlation matrix in the order of the entries, or a CSV of particles
    flat: []                # directions in which the logs say nothing
    noise: {elbow: 0.002}   # that draws lack at each joint, root mean square [rad or m]
    made_by: {method: matching}
    logs: {swing.csv: 5b1c…}    # SHA-256

With zero width everywhere it is an `effects.yaml`.
"""

import csv
import io
import os
from collections.abc import Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any, Literal

import numpy as np
import yaml

from envs.distribution import Distribution, Entry, UnidentifiedDirection
from envs.effects.file import ENTRIES, KEYS, LAW_KEYS, entry_of, parse_entry
from envs.errors import EnvsError, ParameterError, did_you_mean
from envs.marginals import Marginal

ROOT_KEYS = (ENTRIES, "joint", "flat", "noise", "made_by", "logs")
NINETY = 1.6448536269514722  # standard deviations on either side of a 90 % interval
DIGITS = 10  # significant ones of a number in the file
SAME = 1e-6  # value and mean may differ by so much of either


def read(
    path: str | os.PathLike[str] | None, per: Literal["reset", "row"] = "reset"
) -> Distribution:
    """Return the distribution of a file.

    Args:
        path: a distribution.yaml; particles lie next to it.
        per: "reset" draws for each episode; "row" once for each row.

    Raises:
        ParameterError: no path, a file that is missing or no distribution, an unknown key (with the
            nearest), a law or a joint that cannot be; names file and entry.
    """
    if path is None:
        raise ParameterError(
            "params=distribution needs params.path=PATH, the distribution.yaml of run=identify"
        )
    tree = _tree(Path(path).expanduser())
    try:
        entries = [_numbered(n, one) for n, one in enumerate(tree[ENTRIES], 1)]
        joint, particles = _joint(tree.get("joint"), Path(path).expanduser(), entries)
        flat = tuple(
            UnidentifiedDirection(dict(one["parameters"]), float(one["known"]))
            for one in tree["flat"]
        )
        rest = {name: dict(tree[name]) for name in ("noise", "made_by", "logs")}
        return Distribution(tuple(entries), joint, particles, flat=flat, per=per, **rest)
    except EnvsError as error:
        raise ParameterError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise ParameterError(
            f"{path}: flat, noise, made_by or logs is malformed: {error}"
        ) from None


def _tree(path: Path) -> dict[str, Any]:
    """Return the file's mapping, what is optional filled in."""
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"cannot read the distribution {path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path} is not YAML: {error}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get(ENTRIES), list):
        remedy = "; an effects.yaml is given as effects=PATH" if isinstance(tree, list) else ""
        raise ParameterError(f"{path} must be a mapping with a list under `{ENTRIES}`{remedy}")
    for key in tree:
        if key not in ROOT_KEYS:
            hint = did_you_mean(str(key), ROOT_KEYS)
            raise ParameterError(
                f"{path}: unknown key {short(key)}{hint}; choose one of: {', '.join(ROOT_KEYS)}"
            )
    usual = {"flat": [], "noise": {}, "made_by": {}, "logs": {}}
    return {**usual, **{key: value for key, value in tree.items() if value is not None}}


def _numbered(number: int, given: Any) -> Entry:
    try:
        return _entry(given)
    except EnvsError as error:
        raise ParameterError(f"entry {number}: {error}") from None


def _entry(given: Any) -> Entry:
    known = (*KEYS, *LAW_KEYS)
    if not isinstance(given, dict):
        raise ParameterError(f"{short(given)} is not a mapping with the keys {', '.join(known)}")
    for key in given:
        if key not in known:
            hint = did_you_mean(str(key), known)
            raise ParameterError(
                f"unknown key {short(key)}{hint}; choose one of: {', '.join(known)}"
            )
    own = {key: value for key, value in given.items() if key in KEYS}
    effect, mean = parse_entry({**own, "value": given.get("mean", given.get("value"))})
    label, count = effect.label(), len(mean)
    if given.get("value") is not None:
        _, value = parse_entry(own)
        if not np.allclose(value, mean, rtol=SAME, atol=0.0):
            raise ParameterError(
                f"{label}: value={short(given['value'])} is not mean={short(given['mean'])}; "
                "effects= uses the mean; remove one of the two"
            )
    numbers = {key: _column(given, key, label, count) for key in ("std", "low", "high")}
    try:
        columns = zip(mean, *numbers.values(), strict=True)
        laws = tuple(Marginal(given.get("law", "normal"), *column) for column in columns)
    except ParameterError as error:
        raise ParameterError(f"{label}: {error}") from None
    apart = {
        key: None if given.get(key) is None else _column(given, key, label, count)
        for key in ("spread", "uncertainty")
    }
    return Entry(effect, laws, **apart)


def _column(given: Mapping[str, Any], key: str, label: str, count: int) -> tuple[float, ...]:
    """Return a number for each parameter of an entry."""
    value = given.get(key)
    several: list[Any] = value if isinstance(value, list) else [value]
    if len(several) != count or any(
        isinstance(one, bool) or not isinstance(one, int | float) for one in several
    ):
        wanted = "a number" if count == 1 else f"a list of {count} numbers"
        raise ParameterError(f"{label}: {key}={short(value)} must be {wanted}")
    return tuple(float(one) for one in several)


def _joint(
    given: Any, path: Path, entries: list[Entry]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the correlation matrix or the particles."""
    if isinstance(given, str):
        return None, _particles(path.parent / Path(given).name, entries)
    if given is None:
        return None, None
    try:
        return np.array(given, dtype=float), None
    except (TypeError, ValueError):
        raise ParameterError(
            f"joint={short(given)} must be a matrix of numbers, or the name of a CSV"
        ) from None


def _particles(path: Path, entries: list[Entry]) -> np.ndarray:
    names = list(Distribution(tuple(_plain(one) for one in entries)).names)
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
        table = np.array([[float(cell) for cell in row] for row in rows[1:]])
    except OSError as error:
        raise ParameterError(f"cannot read the particles {path}: {error.strerror}") from None
    except ValueError as error:
        raise ParameterError(f"{path}: {error}; each row must be a draw, in numbers") from None
    if not rows or rows[0] != names:
        raise ParameterError(
            f"{path}: its header is {rows[0] if rows else 'missing'}, it must be {','.join(names)}"
        )
    return table


def _plain(entry: Entry) -> Entry:
    """Return an entry whose laws need no particles, to ask for its names."""
    laws = tuple(Marginal("uniform", law.mean, law.std, law.low, law.high) for law in entry.laws)
    return Entry(entry.effect, laws)


def write(path: str | os.PathLike[str], found: Distribution) -> Path:
    """Write a distribution atomically; return its path.

    Particles go into `<stem>_particles.csv` next to it, first.

    Raises:
        OSError: the file cannot be written; a former one is then untouched.
    """
    path, joint = Path(path), None
    if found.particles is not None:
        joint = f"{path.stem}_particles.csv"
        _replace(path.with_name(joint), _csv(found))
    elif found.joint is not None:
        joint = [[_short(value) for value in row] for row in found.joint.tolist()]
    tree = {
        ENTRIES: [_written(entry) for entry in found.entries],
        "joint": joint,
        "flat": [
            {"parameters": {n: _short(w) for n, w in one.parameters.items()}, "known": one.known}
            for one in found.flat
        ],
        "noise": {name: _short(value) for name, value in found.noise.items()},
        "made_by": dict(found.made_by),
        "logs": dict(found.logs),
    }
    text = yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)
    _replace(path, text)
    return path


def _written(entry: Entry) -> dict[str, Any]:
    mean = [_short(law.mean) for law in entry.laws]
    own = entry_of(entry.effect, mean, _interval(entry))

    def column(values: Any) -> Any:
        if values is None:
            return None
        numbers = [_short(value) for value in values]
        return numbers[0] if len(numbers) == 1 else numbers

    return {
        **own,
        "law": entry.laws[0].kind,
        "mean": column(mean),
        **{name: column([getattr(law, name) for law in entry.laws]) for name in LAW_KEYS[2:5]},
        "spread": column(entry.spread),
        "uncertainty": column(entry.uncertainty),
    }


def _interval(entry: Entry) -> tuple[float, float] | None:
    """Return the 90 % interval of the first mean."""
    if entry.uncertainty is None:
        return None
    law, width = entry.laws[0], NINETY * entry.uncertainty[0]
    return _short(max(law.mean - width, law.low)), _short(min(law.mean + width, law.high))


def _csv(found: Distribution) -> str:
    assert found.particles is not None
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(found.names)
    writer.writerows([[repr(float(value)) for value in row] for row in found.particles])
    return out.getvalue()


def _short(value: float) -> float:
    return float(f"{float(value):.{DIGITS}g}")


def _replace(path: Path, text: str) -> None:
    """Write a text under a temporary name and move it into place."""
    temporary = path.with_name(f".{path.stem}-{os.urandom(8).hex()}{path.suffix}")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
