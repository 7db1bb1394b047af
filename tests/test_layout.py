"""The rooms of the project and who may know whom; the size of files."""

import ast
import importlib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("conf", "envs", "hardware", "sim2real")
TORCH = {"torch", "torchrl", "tensordict"}
HYDRA = {"hydra", "omegaconf"}
LEARNS = ("config", "runs", "learning", "evaluation", "deployment")
KNOWS = {  # each room of sim2real/, and the other rooms that it may import
    "runs": set(),
    "config": {"runs"},
    "learning": {"config", "runs"},
    "diagnosis": {"runs"},
    "evaluation": {"learning", "runs"},
    "deployment": {"config", "learning", "runs"},
    "identification": {"diagnosis", "runs"},
    "exam": {"diagnosis", "runs"},
    "loops": set(LEARNS) | {"diagnosis", "identification", "exam"},
    "verbs": set(LEARNS) | {"diagnosis", "identification", "exam", "loops"},
}
FLOORS = (  # of diagnosis/
    *("settings", "evidence", "schema", "data", "locate", "numerics", "ground", "preflight"),
    *("contract", "prepare", "closed_loop", "inference", "experiments", "report", "comparison"),
    *("outcome", "design", "additions", "diagnose"),
)


def sources(*folders: str) -> list[Path]:
    """Return the Python files below folders of the project."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


@cache
def imports(path: Path) -> list[str]:
    """Return the full names of the modules that a file imports, anywhere in it."""
    return list(imported(path))


@cache
def nodes(path: Path) -> list[ast.AST]:
    """Return the imports and calls of a file: where it names other modules."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = (ast.Import, ast.ImportFrom, ast.Call)
    return [node for node in ast.walk(tree) if isinstance(node, kinds)]


def imported(path: Path) -> Iterator[str]:
    """Yield the full names of the modules that a file imports, in its order."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")
        elif (
            isinstance(node, ast.Call)
            and "import_module" in (getattr(node.func, "attr", ""), getattr(node.func, "id", ""))
            and isinstance(node.args[0], ast.Constant)
        ):
            yield str(node.args[0].value)


def targets(path: Path, files: dict[str, Path]) -> Iterator[str]:
    """Yield the project's modules that a file imports, `from package import module` included."""
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.module in files:
            found = [f"{node.module}.{a.name}" for a in node.names]
            inside = [name for name in found if name in files]
            yield from inside
            if len(inside) < len(found):
                yield node.module
    yield from (name for name in imports(path) if name in files and files[name].stem != "__init__")


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
    entry = {ROOT / "sim2real" / "__main__.py", *sources("sim2real/config")}
    assert violations([p for p in sources("sim2real") if p not in entry], HYDRA) == []
    assert violations(sorted(entry), HYDRA) != []


def test_rooms_know_only_whom_they_may() -> None:
    """An import from one room of sim2real/ into another follows the table."""
    folders = {p.name for p in (ROOT / "sim2real").iterdir() if (p / "__init__.py").exists()}
    assert folders == set(KNOWS)
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for room in KNOWS
        for path in sources(f"sim2real/{room}")
        for name in imports(path)
        if name.startswith("sim2real.") and name.split(".")[1] not in {room, *KNOWS[room]}
    ]
    assert wrong == []


def test_the_way_of_a_log_goes_up() -> None:
    """Inside diagnosis/ a floor imports from itself and those below: nothing climbs back."""
    climbs = []
    for path in sources("sim2real/diagnosis"):
        floor = path.relative_to(ROOT / "sim2real" / "diagnosis").parts[0].removesuffix(".py")
        for name in imports(path):
            parts = name.split(".")
            inside = parts[:2] == ["sim2real", "diagnosis"] and len(parts) > 2 and floor in FLOORS
            if inside and FLOORS.index(parts[2]) > FLOORS.index(floor):
                climbs.append(f"{path.relative_to(ROOT)} imports {name}")
    assert climbs == []


def test_no_module_imports_itself_around_a_corner() -> None:
    """There are no circles of imports, not even of those inside functions."""
    files = {".".join(p.relative_to(ROOT).with_suffix("").parts): p for p in sources(*ROOMS)}
    files = {name.removesuffix(".__init__"): path for name, path in files.items()}
    graph = {name: {i for i in targets(path, files)} - {name} for name, path in files.items()}
    sorter = TopologicalSorter(graph)
    try:
        sorter.prepare()
    except CycleError as error:
        pytest.fail(f"a circle of imports: {' -> '.join(error.args[1])}")


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
