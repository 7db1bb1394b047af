"""The stubs of MuJoCo: each name is there in the installed library, of the type that they say."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest
from mujoco import _enums, _specs, _structs

STUBS = Path(__file__).resolve().parent.parent / "typings" / "mujoco"
KINDS = {  # a field's type, and what the library's own text of it says
    "_Floats": "float64",
    "_Singles": "float32",
    "_Ints": "int32",
    "_Bools": "bool",
    "_Int": r"-> int\b",
    "_Float": r"-> float\b",
    "str": r"-> str\b",
    "bool": r"-> bool\b",
}
TREES = {path.name: ast.parse(path.read_text(encoding="utf-8")) for path in STUBS.glob("*.pyi")}
OURS = {"_Enum", "_Element", "_Field"}  # bases of the stubs, which the library lacks


def classes() -> Iterator[tuple[str, ast.ClassDef]]:
    """Yield each class of the stubs that stands for one of the library."""
    for tree in TREES.values():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and node.name not in OURS:
                yield node.name, node


def installed(name: str) -> type:
    """Return a class of the library, which keeps its views to itself."""
    for module in (mujoco, _structs, _specs, _enums):
        if hasattr(module, name):
            return getattr(module, name)
    raise AssertionError(f"mujoco has no class {name}")


def parameters(node: ast.FunctionDef) -> list[str]:
    """Return the names of a stub's parameters, without `self` and those given by place alone."""
    names = [*node.args.args, *node.args.kwonlyargs]
    return [name.arg for name in names if name.arg != "self"]


def check_call(node: ast.FunctionDef, text: str) -> None:
    """Take a function whose parameters the library's text names too."""
    for name in parameters(node):
        assert re.search(rf"\b{name}: ", text), f"{node.name}: {name}"


@pytest.mark.parametrize(("name", "node"), list(classes()))
def test_a_class_is_as_installed(name: str, node: ast.ClassDef) -> None:
    """Each attribute is there; fields are of their type, methods take their arguments."""
    kind = installed(name)
    for part in node.body:
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name):
            found = getattr(kind, part.target.id)
            said = KINDS.get(ast.unparse(part.annotation))
            text = str(getattr(found.fget, "__doc__", "")) if isinstance(found, property) else ""
            assert not said or re.search(said, text), f"{name}.{part.target.id}: {text}"
        elif isinstance(part, ast.FunctionDef) and part.name != "__init__":
            found = getattr(kind, part.name)
            if not part.decorator_list:
                check_call(part, found.__doc__ or "")


def test_functions_are_as_installed() -> None:
    """Each is there with the same parameters in the same order."""
    for node in TREES["_functions.pyi"].body:
        if isinstance(node, ast.FunctionDef):
            text = (getattr(mujoco, node.name).__doc__ or "").split(" -> ")[0]
            assert re.findall(r"(\w+): ", text) == parameters(node), node.name
