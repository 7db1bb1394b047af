"""The rooms of the project and who may know whom; the size of files."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("conf", "envs", "hardware", "sim2real")
TORCH = {"torch", "torchrl", "tensordict"}
HYDRA = {"hydra", "omegaconf"}


def sources(*folders: str) -> list[Path]:
    """Return the Python files below folders of the project."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def imports(path: Path) -> Iterator[str]:
    """Yield the full names of the modules that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")
        elif (
            isinstance(node, ast.Call)
            and ast.unparse(node.func).endswith("import_module")
            and isinstance(node.args[0], ast.Constant)
        ):
            yield str(node.args[0].value)


def violations(paths: list[Path], forbidden: set[str]) -> list[str]:
    """Return "file imports module" for each import of a forbidden package."""
    return [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in paths
        for name in imports(path)
        if name.split(".")[0] in forbidden
    ]


def test_envs_know_neither_hardware_nor_sim2real() -> None:
    """The simulated worlds stand alone."""
    assert violations(sources("envs"), {"hardware", "sim2real", "conf", *HYDRA}) == []


def test_hardware_runs_on_a_small_computer() -> None:
    """Only hardware/env.py knows torch and envs, and nothing there knows sim2real."""
    assert violations(sources("hardware"), {"sim2real", "conf", *HYDRA}) == []
    plain = [path for path in sources("hardware") if path != ROOT / "hardware" / "env.py"]
    assert violations(plain, {"envs", *TORCH}) == []


def test_only_the_entry_knows_hydra() -> None:
    """Everything below __main__ and config takes ordinary arguments."""
    entry = {ROOT / "sim2real" / "__main__.py", ROOT / "sim2real" / "config.py"}
    assert violations([p for p in sources("sim2real") if p not in entry], HYDRA) == []
    assert violations(sorted(entry), HYDRA) != []


def test_nothing_imports_an_entry_or_by_a_relative_path() -> None:
    """Entry points are leaves, and every import says its whole name."""
    found = [(p.name, name) for p in sources(*ROOMS) for name in imports(p)]
    assert [f for f in found if f[1].endswith("__main__")] == []
    assert [f for f in found if f[1].startswith(".")] == []


def test_a_wrong_arrow_is_found(tmp_path: Path) -> None:
    """The walk sees imports inside functions and those made by name."""
    file = tmp_path / "wrong.py"
    file.write_text(
        "import importlib\ndef f():\n    from sim2real import es\n"
        "    importlib.import_module('torch.nn')\n"
    )
    assert list(imports(file)) == ["importlib", "sim2real", "torch.nn"]


def test_conf_is_data() -> None:
    """conf/ holds YAML and nothing that runs."""
    assert {path.suffix for path in (ROOT / "conf").rglob("*") if path.is_file()} <= {".yaml"}


@pytest.mark.parametrize("room", ["envs", "hardware", "sim2real"])
def test_the_imported_package_is_ours(room: str) -> None:
    """The rooms' names are common ones; what Python finds under them is this checkout."""
    found = importlib.import_module(room).__file__
    assert found is not None
    assert Path(found).resolve().parent == ROOT / room
    assert (ROOT / room / "py.typed").exists()


def test_files_are_short() -> None:
    """No file is over 400 lines."""
    long = {
        p.name: n
        for p in sources(*ROOMS, "tests", "benchmarks")
        if (n := len(p.read_text().splitlines())) > 400
    }
    assert long == {}
