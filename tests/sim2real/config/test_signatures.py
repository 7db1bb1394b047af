"""Signatures are read from sources; trees are held against them."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sim2real.config import signatures
from sim2real.config.targets import ConfigError, build, check, marked

SOURCE = """
from __future__ import annotations
from dataclasses import dataclass
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Literal
from made_up import Elsewhere
Colour = Literal["red", "green"]
class Base:
    def __init__(self, size: int, colour: Colour | None = None) -> None: ...
class Child(Base): ...
@dataclass
class Record:
    kind: ClassVar[str] = "x"
    names: Sequence[str]
    limits: Mapping[str, float]
    other: Elsewhere
    share: float = 0.0
    on: "bool" = True
def open_ended(*, a: int, **rest: int) -> None: ...
Maker = Callable[..., Record]
class Called(Child):
    def __call__(self) -> None: ...
def takes(one: Maker, some: Sequence[Maker], by_name: Mapping[str, Maker] | None, made: Record): ...
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A source file in the place of a package of the project."""
    (tmp_path / "envs").mkdir()
    (tmp_path / "envs" / "sample.py").write_text(SOURCE)
    monkeypatch.setattr(signatures, "_ROOT", tmp_path)
    signatures.find.cache_clear()
    signatures._load.cache_clear()
    yield "envs.sample"
    signatures.find.cache_clear()
    signatures._load.cache_clear()


def test_signatures_are_read_from_the_source(module: str) -> None:
    """Inherited constructors, dataclasses and functions are understood without an import."""
    child, record = signatures.find(f"{module}.Child"), signatures.find(f"{module}.Record")
    assert child is not None and record is not None
    assert [(a.name, a.required) for a in child.arguments.values()] == [
        ("size", True),
        ("colour", False),
    ]
    assert list(record.arguments) == ["names", "limits", "other", "share", "on"]
    function = signatures.find(f"{module}.open_ended")
    assert function is not None and function.open
    assert "envs.sample" not in sys.modules


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("Child.size", [0, -3], [True, 1.0, "1", None]),
        ("Child.colour", ["red", None], ["blue", 1]),
        ("Record.names", [[], ["a"]], ["a", [1], None]),
        ("Record.limits", [{}, {"a": 1.5}], [[1], {"a": "b"}]),
        ("Record.other", [{"_target_": "x.y"}, 1], []),
        ("Record.share", [1, 0.5], [True, "0.5", {"_target_": "x.y"}]),
        ("Record.on", [True, False], [0, "true"]),
    ],
)
def test_values_are_held_against_type_hints(module: str, name: str, good: list[Any], bad) -> None:
    """Each kind of hint accepts what it names and nothing else; an unknown one accepts anything."""
    of, argument = name.split(".")
    found = signatures.find(f"{module}.{of}")
    assert found is not None
    assert all(found.arguments[argument].accepts(value) for value in good)
    assert not any(found.arguments[argument].accepts(value) for value in bad)


def test_what_an_argument_makes_later_is_marked(module: str) -> None:
    """An argument's type says whether the object or what makes it is meant, also in lists."""
    later, child = {"_target_": f"{module}.Record"}, {"_target_": f"{module}.Called", "size": 1}
    tree = {"_target_": f"{module}.takes", "one": later, "some": [later], "made": dict(later)}
    tree["by_name"] = {"first": later, "second": child}
    made = later | {"_partial_": True}
    assert marked(tree) == tree | {
        "one": made,
        "some": [made],
        "by_name": {"first": made, "second": child},  # whose objects are called themselves
    }
    check(marked(tree | {"made": later | {"names": [], "limits": {}, "other": 1}}), "x")
    with pytest.raises(ConfigError, match=r"x\.one=3: expected an object"):
        check(tree | {"one": 3}, "x")


def test_a_class_of_torchrl_is_given_what_makes_its_layers() -> None:
    """A hint of the library says so in place of `_partial_`, which may still stand."""
    tanh = {"_target_": "torch.nn.Tanh"}
    for activation in (tanh, tanh | {"_partial_": True}):
        tree = {"_target_": "torchrl.modules.MLP", "in_features": 2, "out_features": 1}
        tree |= {"num_cells": [3], "activation_class": activation}
        assert [type(layer).__name__ for layer in build(tree, "x")] == ["Linear", "Tanh", "Linear"]
