"""Signatures of this project's classes and functions, read from source without importing.

    find("envs.Randomization").arguments["per"].describe()     # "one of reset, row"

Only files of the project's own packages are read, and only their `class`, `def`, `import` and `=`
statements at the top. That is why a configuration can be checked before PyTorch is imported.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

PACKAGES = ("sim2real", "envs", "hardware")
FOREIGN = ("torch", "torchrl", "tensordict")
OWN: dict[str, Path] = {}  # a user's modules, and under "" the folder they are in
_ROOT = Path(__file__).resolve().parents[2]
_SCALARS = {"int": int, "float": (int, float), "str": str, "bool": bool, "Path": str}
_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "Path": "a path",
    "None": "null",
}
_LISTS = ("Sequence", "Iterable", "Collection", "list", "tuple")
_MAPS = ("Mapping", "MutableMapping", "dict")
_MAKERS = ("Callable", "partial", "type")  # types that make an object from further arguments


@dataclass(frozen=True)
class Module:
    """The top of a source file."""

    name: str
    path: Path
    body: tuple[ast.stmt, ...] = field(repr=False, compare=False)


@dataclass(frozen=True)
class Argument:
    """An argument of a constructor or function."""

    name: str  # the name of the argument
    hint: ast.expr | None  # its annotation, or None
    required: bool  # whether it has no default
    module: Module  # where names in the annotation are looked up

    def accepts(self, value: Any) -> bool:
        """Return whether a plain value of YAML can be this argument, as far as its hint says."""
        return _fits(value, self.hint, self.module)

    def describe(self) -> str:
        """Return in words what the argument can be."""
        return _describe(self.hint, self.module)

    def choices(self) -> list[str]:
        """Return the names that the argument can be, if it is one of a closed set."""
        return [str(v) for v in _literals(self.hint, self.module)]

    @property
    def makes(self) -> bool:
        """Whether it is what makes an object, not the object."""
        kinds = {kind for kind, *_ in _alternatives(self.hint, self.module)}
        return kinds - {"None"} == {"maker"}

    @property
    def is_object_or_its_keys(self) -> bool:
        """Whether a mapping can stand for the object, so that the object's class checks names."""
        return {"object", "map"} <= {kind for kind, *_ in _alternatives(self.hint, self.module)}

    def inner(self) -> Argument:
        """Return the type of the items of a list or a mapping that is given for the argument."""
        ways = _alternatives(self.hint, self.module)
        items = [(hint, module) for kind, hint, module in ways if kind in ("list", "map")]
        hint, module = items[0] if items else (None, self.module)
        return Argument(self.name, hint, False, module)


@dataclass(frozen=True)
class Signature:
    """The arguments that can be given by name."""

    name: str  # the name of the class or function, without its module
    arguments: dict[str, Argument]  # the arguments by name
    open: bool  # whether any other name is taken too
    callable: bool = False  # whether it is a class whose objects can be called


@cache
def find(target: str) -> Signature | None:
    """Return the signature of `package.module.Name`; None if the project has no such thing."""
    found = _definition(*target.rpartition(".")[::2])
    if found is None:
        return None
    node, module = found
    if isinstance(node, ast.ClassDef):
        return _of_class(node, module)
    if isinstance(node, ast.FunctionDef):
        return Signature(node.name, *_of_function(node, module, skip=0))
    return None


def makes(hint: object) -> bool:
    """Return whether a hint, the text of one, asks for what makes an object; see `Argument`."""
    if not isinstance(hint, str):
        return False
    return Argument("", ast.Constant(hint), True, Module("", Path(), ())).makes


def names(module: str) -> list[str]:
    """Return the names that a module of the project defines or imports; [] without the module."""
    source = _load(module)
    return [] if source is None else sorted({name for name, _ in _bindings(source)})


@cache
def _load(name: str) -> Module | None:
    parts = name.split(".")
    if parts[0] not in (*PACKAGES, *OWN) or not all(part.isidentifier() for part in parts):
        return None
    place = OWN.get(parts[0], _ROOT).joinpath(*parts)
    for path in (place / "__init__.py", place.with_suffix(".py")):
        if path.is_file():
            return Module(name, path, tuple(ast.parse(path.read_text(encoding="utf-8")).body))
    return None


def _bindings(module: Module) -> Iterator[tuple[str, ast.stmt]]:
    for node in module.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            for alias in node.names:
                yield alias.asname or alias.name, node
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                if isinstance(target, ast.Name):
                    yield target.id, node


def _definition(module: str, name: str) -> tuple[ast.stmt, Module] | None:
    """Follow a name through the project's imports to the statement that defines it."""
    source = _load(module)
    for bound, node in _bindings(source) if source else ():
        if bound != name:
            continue
        if not isinstance(node, ast.ImportFrom):
            return node, source  # type: ignore[return-value]
        original = next(a.name for a in node.names if (a.asname or a.name) == name)
        return _definition(node.module or "", original)
    return None


def _of_class(node: ast.ClassDef, module: Module) -> Signature:
    own = {part.name: part for part in node.body if isinstance(part, ast.FunctionDef)}
    parents = [parent for base in node.bases if (parent := _base(base, module)) is not None]
    called = "__call__" in own or any(parent.callable for parent in parents)
    if "__init__" in own:
        takes = _of_function(own["__init__"], module, skip=1)
        return Signature(node.name, *takes, callable=called)
    arguments: dict[str, Argument] = {}
    for parent in parents:
        arguments |= parent.arguments
    if _is_dataclass(node):
        arguments |= {a.name: a for a in _fields(node, module)}
    is_open = any(parent.open for parent in parents)
    return Signature(node.name, arguments, is_open, callable=called)


def clear_cache() -> None:
    """Read sources again: other modules are importable."""
    find.cache_clear()
    _load.cache_clear()


def _base(base: ast.expr, module: Module) -> Signature | None:
    if isinstance(base, ast.Name) and _is_foreign(base.id, module):
        return Signature(base.id, {}, open=True)  # its source is not read
    found = _definition(module.name, base.id) if isinstance(base, ast.Name) else None
    return _of_class(*found) if found and isinstance(found[0], ast.ClassDef) else None  # type: ignore[arg-type]


def _is_foreign(name: str, module: Module) -> bool:
    """Return whether a module imports a name from TorchRL, torch or tensordict."""
    return any(
        bound == name
        and isinstance(node, ast.ImportFrom)
        and (node.module or "").split(".")[0] in FOREIGN
        for bound, node in _bindings(module)
    )


def _is_dataclass(node: ast.ClassDef) -> bool:
    marks = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
    return any(isinstance(mark, ast.Name) and mark.id == "dataclass" for mark in marks)


def _fields(node: ast.ClassDef, module: Module) -> Iterator[Argument]:
    for part in node.body:
        if not isinstance(part, ast.AnnAssign) or "ClassVar" in ast.unparse(part.annotation):
            continue
        if isinstance(part.target, ast.Name):
            yield Argument(part.target.id, part.annotation, part.value is None, module)


def _of_function(
    node: ast.FunctionDef, module: Module, skip: int
) -> tuple[dict[str, Argument], bool]:
    given = node.args
    plain = (given.posonlyargs + given.args)[skip:]
    needed = len(plain) - len(given.defaults)
    arguments = {
        a.arg: Argument(a.arg, a.annotation, i < needed, module) for i, a in enumerate(plain)
    }
    for a, default in zip(given.kwonlyargs, given.kw_defaults, strict=True):
        arguments[a.arg] = Argument(a.arg, a.annotation, default is None, module)
    return arguments, given.kwarg is not None


def _alternatives(
    hint: ast.expr | None, module: Module
) -> Iterator[tuple[str, ast.expr | None, Module]]:
    """Yield (kind, detail, module) for each type that a hint allows."""
    if hint is None:
        yield "any", None, module
    elif isinstance(hint, ast.Constant):
        if isinstance(hint.value, str):
            yield from _alternatives(ast.parse(hint.value, mode="eval").body, module)
        else:
            yield "None", None, module
    elif isinstance(hint, ast.BinOp):
        yield from _alternatives(hint.left, module)
        yield from _alternatives(hint.right, module)
    elif isinstance(hint, ast.Subscript) and isinstance(hint.value, ast.Name):
        yield from _generic(hint.value.id, hint.slice, module)
    elif isinstance(hint, ast.Name):
        yield from _named(hint.id, module)
    else:
        yield "any", None, module


def _generic(
    name: str, inner: ast.expr, module: Module
) -> Iterator[tuple[str, ast.expr | None, Module]]:
    if name == "Literal":
        yield "Literal", inner, module
    elif name == "Optional":
        yield "None", None, module
        yield from _alternatives(inner, module)
    elif name in _LISTS:
        first = inner.elts[0] if isinstance(inner, ast.Tuple) else inner
        plain = isinstance(inner, ast.Tuple) and any(
            ast.unparse(e) != "..." for e in inner.elts[1:]
        )
        yield "list", None if plain else first, module
    elif name in _MAPS:
        value = inner.elts[1] if isinstance(inner, ast.Tuple) and len(inner.elts) == 2 else None
        yield "map", value, module
    elif name in _MAKERS:
        yield "maker", None, module
    else:
        yield "any", None, module


def _named(name: str, module: Module) -> Iterator[tuple[str, ast.expr | None, Module]]:
    if name in _SCALARS:
        yield name, None, module
    elif name in _LISTS or name in _MAPS:
        yield "list" if name in _LISTS else "map", None, module
    elif name in _MAKERS:
        yield "maker", None, module
    else:
        found = _definition(module.name, name)
        if found and isinstance(found[0], ast.Assign):
            yield from _alternatives(found[0].value, found[1])
        else:
            yield "any" if name in ("Any", "object") or not found else "object", None, module


def _values(inner: ast.expr | None) -> list[Any]:
    elements = inner.elts if isinstance(inner, ast.Tuple) else [inner]
    return [e.value for e in elements if isinstance(e, ast.Constant)]


def _literals(hint: ast.expr | None, module: Module) -> list[Any]:
    return [
        v
        for kind, inner, _ in _alternatives(hint, module)
        if kind == "Literal"
        for v in _values(inner)
    ]


def _fits(value: Any, hint: ast.expr | None, module: Module) -> bool:
    return any(_fits_one(value, *way) for way in _alternatives(hint, module))


def _fits_one(value: Any, kind: str, inner: ast.expr | None, module: Module) -> bool:
    if isinstance(value, dict) and "_target_" in value:
        return kind not in (*_SCALARS, "Literal", "None")
    if kind == "any":
        return True
    if kind in ("object", "maker"):
        return isinstance(value, dict)
    if kind == "None":
        return value is None
    if kind == "Literal":
        return any(value == v and type(value) is type(v) for v in _values(inner))
    if kind == "list":
        return isinstance(value, list) and all(_fits(v, inner, module) for v in value)
    if kind == "map":
        return isinstance(value, dict) and all(_fits(v, inner, module) for v in value.values())
    is_bool = isinstance(value, bool)
    return isinstance(value, _SCALARS[kind]) and is_bool == (kind == "bool")


def _describe(hint: ast.expr | None, module: Module) -> str:
    words = []
    for kind, inner, where in _alternatives(hint, module):
        if kind == "Literal":
            words.append("one of " + ", ".join(map(str, _values(inner))))
        elif kind == "list":
            words.append(
                "a list" if inner is None else f"a list of which each is {_describe(inner, where)}"
            )
        elif kind == "map":
            words.append("a mapping of names to values")
        elif kind in ("object", "maker"):
            words.append("an object (with a _target_)")
        else:
            words.append(_WORDS.get(kind, "anything"))
    return " or ".join(dict.fromkeys(words))
