"""Plain trees of names and numbers that describe objects, as in conf/ and a run's config.yaml.

    tree = {"_target_": "envs.Randomization", "draws": [], "per": "reset"}
    check(tree, "params")            # quick: reads sources, imports nothing
    tasks = build(tree, "params")    # Randomization(draws=[], per="reset")

`_target_` names a class or a function of this project, or a class of TorchRL or torch. Where an
argument is what makes an object (`Callable[..., X]`), the object is made later, with arguments of
the program's; elsewhere `_partial_: true` says so. No other code can be reached, so a tree from a
stranger is data.
"""

import functools
import importlib
import inspect
import math
from collections.abc import Callable, Iterator
from typing import Any

from envs.errors import did_you_mean
from sim2real.config import signatures
from sim2real.config.renamed import current_target
from sim2real.runs.errors import Sim2RealError

FOREIGN = ("torchrl", "torch")
MARKS = ("_target_", "_partial_")


class ConfigError(Sim2RealError):
    """A configuration names what is not there, or gives a value that cannot be."""


def check(tree: Any, where: str) -> None:
    """Compare a tree with the signatures of the classes that it names.

    Args:
        tree: mappings, lists, numbers, text, None.
        where: the tree's place in the configuration, such as `algorithm`.

    Raises:
        ConfigError: a target that is not allowed or not there, a key that it does not take (with
            the nearest that it does), a key that it needs, a value of the wrong type.
    """
    for place, node in _nodes(tree, where):
        arguments = {key: value for key, value in node.items() if key not in MARKS}
        signature = _signature(node["_target_"], place)
        if signature is not None:
            _check_arguments(signature, arguments, place, bool(node.get("_partial_", False)))


def marked(tree: Any, argument: signatures.Argument | None = None) -> Any:
    """Return a tree with `_partial_: true` at every object that is made later.

    These are the objects that stand for an argument of one of our classes or functions which is
    what makes an object, unless the object can itself be called.

    Args:
        tree: mappings, lists, numbers, text, None.
        argument: what the tree is given for.
    """
    if isinstance(tree, list):
        return [marked(one, argument and argument.inner()) for one in tree]
    if not isinstance(tree, dict):
        return tree
    if "_target_" not in tree:
        return {key: marked(one, argument and argument.inner()) for key, one in tree.items()}
    target = tree["_target_"]
    found = signatures.find(target) if isinstance(target, str) else None
    takes = found.arguments if found else {}
    later = argument is not None and argument.makes and not (found and found.callable)
    made = {key: marked(one, takes.get(key)) for key, one in tree.items()}
    return {"_partial_": True, **made} if later else made


def build(tree: Any, where: str) -> Any:
    """Check a configuration and build the object that it describes.

    Raises:
        ConfigError: see `check`.
        ValueError: a value that a constructor refuses.
    """
    check(tree, where)
    return _build(tree, where)


def build_named(tree: dict[str, Any] | None, where: str) -> dict[str, Callable[..., Any]]:
    """Check a mapping of names to trees and return, by name, what makes new ones of them.

    Raises:
        ConfigError: see `check_named`.
    """
    check_named(tree, where)
    own = {name: {**one, "_partial_": True} for name, one in (tree or {}).items()}
    return {name: _build(one, f"{where}.{name}") for name, one in own.items()}


def check_named(tree: dict[str, Any] | None, where: str) -> None:
    """Check a mapping of names to trees, each of which describes an object; see `check`.

    Raises:
        ConfigError: an object that has no name, or a name without an object; see also `check`.
    """
    if tree and "_target_" in tree:
        raise ConfigError(
            f"{where}._target_={tree['_target_']}: {where} holds objects by name; give this one a "
            f"name, as in NAME: {{_target_: {tree['_target_']}, ...}}"
        )
    for name, one in (tree or {}).items():
        if not (isinstance(one, dict) and "_target_" in one):
            shown = "null" if one is None else repr(one)
            raise ConfigError(
                f"{where}.{name}={shown}: expected a mapping with a _target_; to leave {name} "
                f"out, write ~{where}.{name}"
            )
    check(tree, where)


def import_target(target: str, where: str) -> Callable[..., Any]:
    """Import and return what a `_target_` names.

    Raises:
        ConfigError: it is not one of ours, nor a class of TorchRL or torch.
    """
    target = current_target(target)
    ours = _signature(target, where) is not None
    module, _, name = target.rpartition(".")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        if ours:
            raise
        raise ConfigError(f"{where}._target_={target}: no such class") from error
    home = getattr(found, "__module__", "").split(".")[0]
    if not ours and not (inspect.isclass(found) and home in FOREIGN):
        raise ConfigError(
            f"{where}._target_={target}: only classes of {' and '.join(FOREIGN)} can be used"
        )
    return found


def _nodes(tree: Any, where: str) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(tree, dict):
        if "_target_" in tree:
            yield where, tree
        for key, value in tree.items():
            yield from _nodes(value, f"{where}.{key}" if where else str(key))
    elif isinstance(tree, list):
        for index, value in enumerate(tree):
            yield from _nodes(value, f"{where}[{index}]")


def _signature(target: Any, where: str) -> signatures.Signature | None:
    """Return the signature of one of our classes or functions; None for TorchRL's and torch's."""
    target = current_target(target) if isinstance(target, str) else target
    package = target.split(".")[0] if isinstance(target, str) else ""
    if package in FOREIGN:
        return None
    if package not in (*signatures.PACKAGES, *filter(None, signatures.OWN)):
        allowed = ", ".join([*signatures.PACKAGES, *filter(None, signatures.OWN), *FOREIGN])
        raise ConfigError(
            f"{where}._target_={target!r} is not allowed; it must be a class of {allowed}, or of a "
            "module in the folder that --config-dir names"
        )
    signature = signatures.find(target)
    if signature is None:
        module, _, name = target.rpartition(".")
        hint = did_you_mean(name, signatures.names(module))
        raise ConfigError(f"{where}._target_={target}: no such class{hint}")
    return signature


def _check_arguments(
    signature: signatures.Signature, given: dict[str, Any], where: str, partial: bool
) -> None:
    prefix = f"{where}." if where else ""
    for key, value in given.items():
        argument = signature.arguments.get(key)
        if argument is None and not signature.open:
            known = ", ".join(signature.arguments) or "nothing"
            hint = did_you_mean(key, signature.arguments)
            raise ConfigError(
                f"{prefix}{key}: {signature.name} does not accept {key!r}{hint}; it accepts {known}"
            )
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"{prefix}{key}={value}: expected a finite number")
        if argument is not None and not argument.accepts(value):
            shown = "null" if value is None else repr(value)
            hint = did_you_mean(value, argument.choices()) if isinstance(value, str) else ""
            raise ConfigError(f"{prefix}{key}={shown}: expected {argument.describe()}{hint}")
    missing = [a.name for a in signature.arguments.values() if a.required and a.name not in given]
    if missing and not partial:
        raise ConfigError(f"{where}: {signature.name} also needs {', '.join(missing)}")


def _build(tree: Any, where: str) -> Any:
    if isinstance(tree, list):
        return [_build(value, f"{where}[{i}]") for i, value in enumerate(tree)]
    if not isinstance(tree, dict):
        return tree
    make = import_target(tree["_target_"], where) if "_target_" in tree else None
    foreign = make if make and tree["_target_"].split(".")[0] in FOREIGN else None
    tree = _marked_foreign(foreign, tree) if foreign else tree
    built = {
        key: _build(value, f"{where}.{key}") for key, value in tree.items() if key not in MARKS
    }
    if make is None:
        return built
    if foreign:
        _check_foreign(foreign, built, where)
    later = DeferredObject(make, **built)
    later.place = where
    return later if tree.get("_partial_", False) else later()


def _marked_foreign(make: Callable[..., Any], tree: dict[str, Any]) -> dict[str, Any]:
    """Do for a class of TorchRL or torch what `marked` does for ours: its source is not read."""
    takes = inspect.signature(make).parameters
    return {
        key: {"_partial_": True, **value}
        if isinstance(value, dict)
        and "_target_" in value
        and key in takes
        and signatures.makes(takes[key].annotation)
        else value
        for key, value in tree.items()
    }


class DeferredObject(functools.partial):
    """A configured object whose remaining arguments are supplied later; errors name its location.

    Raises, when called:
        ConfigError: a value that a constructor of a library refuses, with its place.
    """

    place = ""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Make it."""
        try:
            return super().__call__(*args, **kwargs)
        except ValueError as error:
            if _of_project(error):
                raise
            raise ConfigError(f"{self.place}: {error}; arguments: {self._given()}") from error

    def _given(self) -> str:
        """Return the numbers and names that the configuration holds for it."""
        plain = {n: v for n, v in self.keywords.items() if isinstance(v, str | int | float | None)}
        return ", ".join(f"{self.place}.{name}={value}" for name, value in plain.items())


def _of_project(error: BaseException) -> bool:
    """Return whether a class of this project's own says what is wrong."""
    return type(error).__module__.split(".")[0] in signatures.PACKAGES


def _check_foreign(make: Callable[..., Any], given: dict[str, Any], where: str) -> None:
    known = inspect.signature(make).parameters
    takes_any = any(p.kind is p.VAR_KEYWORD for p in known.values())
    for key in given:
        if key not in known and not takes_any:
            raise ConfigError(
                f"{where}.{key}: {make.__name__} does not accept {key!r}{did_you_mean(key, known)}"
            )
