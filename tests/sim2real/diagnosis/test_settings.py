"""The settings of a diagnosis: every one is described, reaches its stage, and few hide elsewhere.

What counts as a number without a name: every literal in `sim2real/diagnosis` other than 0 and 1,
but for whole numbers in an index or slice, the exponent of a square, and the values of constants
and settings, which are names (an assignment in capitals at the top of a module; the settings
classes). Halves and doubles count.
"""

import ast
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis import settings
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import DEFAULT, Settings, rows
from tests.sim2real.diagnosis import arm

ROOM = Path(settings.__file__).parents[1]
ORIGINS = ("derived", "reference", "measured", "tuned", "convention")
ORIGINS += ("set by hand", "judgement", "computing time")
MOST = 9.0  # numbers without a name per 1000 lines


class _Unnamed(ast.NodeVisitor):
    """Gathers the lines of numbers without a name."""

    def __init__(self) -> None:
        self.lines: list[int] = []
        self._inside = 0  # of functions and classes

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._inside += 1
        self.generic_visit(node)
        self._inside -= 1

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._inside += 1
        self.generic_visit(node)
        self._inside -= 1

    def visit_Assign(self, node: ast.Assign | ast.AnnAssign) -> None:
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        names = [n.id for target in targets for n in ast.walk(target) if type(n) is ast.Name]
        if self._inside or not all(name.isupper() for name in names):
            self.generic_visit(node)

    visit_AnnAssign = visit_Assign  # noqa: N815

    def visit_Call(self, node: ast.Call) -> None:
        if not (isinstance(node.func, ast.Name) and node.func.id == "setting"):
            self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        if any(
            isinstance(n, ast.Constant) and type(n.value) is float for n in ast.walk(node.slice)
        ):
            self.visit(node.slice)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        square = isinstance(node.op, ast.Pow) and getattr(node.right, "value", None) == 2
        self.visit(node.left)
        if not square:
            self.visit(node.right)

    def visit_Constant(self, node: ast.Constant) -> None:
        if type(node.value) in (int, float, complex) and node.value not in (0, 1):
            self.lines.append(node.lineno)


def unnamed(text: str) -> list[int]:
    """Return the lines of a module's numbers without a name."""
    found = _Unnamed()
    found.visit(ast.parse(text))
    return found.lines


def test_the_counter_sees_what_it_should() -> None:
    """Literals in functions count; constants, settings, indices, squares, 0 and 1 do not."""
    text = """
LIMIT = 0.3
other = 4.0
class A:
    x: float = setting(7.0, "a", "b", unit="s")
    y = 8.0
def f(x, y=3.0):
    z = 0.5 * x[2] ** 2 + x[3:] + 1
    LOCAL = 9
    return z > 2e-3
"""
    assert unnamed(text) == [3, 6, 7, 8, 9, 10]


def test_few_numbers_have_no_name() -> None:
    """Numbers that steer the diagnosis stand in its settings."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(ROOM.rglob("*.py"))}
    found = {path.relative_to(ROOM): unnamed(text) for path, text in texts.items()}
    lines = sum(len(text.splitlines()) for text in texts.values())
    share = 1000 * sum(map(len, found.values())) / lines
    worst = sorted(found, key=lambda path: -len(found[path]))[:5]
    told = "; ".join(f"{path}: lines {found[path]}" for path in worst)
    assert share <= MOST, f"{share:.1f} numbers per 1000 lines have no name; most in {told}"


def test_every_setting_says_what_it_is() -> None:
    """Unit, meaning and origin of each, and no number of two names in one stage."""
    described = list(rows(DEFAULT))
    assert len(described) <= 230  # fewer is better
    for row in described:
        assert row.meaning, row
        assert row.origin.startswith(ORIGINS), row
        assert row.unit or isinstance(np.asarray(row.value).flat[0], str), row
    names = [(row.stage, row.name) for row in described]
    assert len(set(names)) == len(names)


def test_settings_cannot_be_changed_or_misspelled() -> None:
    """A stage is frozen, and refuses a name that it does not have."""
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(DEFAULT.inference, "usual", 0.5)  # noqa: B010 - a checker refuses the plain line
    misspelled: dict[str, Any] = {"usal": 0.5}
    with pytest.raises(TypeError):
        settings.Inference(**misspelled)


def test_settings_reach_the_stages(tmp_path: Path) -> None:
    """Data of other settings is cut into other blocks."""
    (tmp_path / "arm.xml").write_text(arm.XML)
    log = arm.make_log(("coulomb_friction", {"where": "a"}, 0.1))
    blocks = []
    for seconds in (1.0, 0.25):
        chosen = Settings(bootstrap=settings.Bootstrap(block_s=seconds))
        data = Data.of([log], tmp_path / "arm.xml", chosen)
        assert data.settings is chosen
        blocks.append(len(np.unique(data.blocks(0.0))))
    assert blocks[1] > 2 * blocks[0]
