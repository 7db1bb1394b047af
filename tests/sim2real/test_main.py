"""The command line from end to end, in this process: folders, sweeps, exit statuses."""

import errno
import json
import logging
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import pytest
import yaml

from hardware.log import write_log
from sim2real import __main__ as entry
from sim2real.config.targets import ConfigError, check
from sim2real.runs.tables import Table
from tests.sim2real.diagnosis import arm

TINY = ["+experiment=nav2d", "iterations=1", "eval=none", "algorithm.pairs=2", "adapt.queries=2"]
TINY += ["algorithm.num_rows=4", "algorithm.refill=1", "env.max_steps=5", "logger=csv"]
Run = Callable[..., int]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    """Run the command line in an empty folder and return its exit status."""
    monkeypatch.chdir(tmp_path)
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level

    def call(*argv: str) -> int:
        monkeypatch.setattr(sys, "argv", ["sim2real", *argv])
        try:
            entry.main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    yield call
    for handler in [h for h in root.handlers if h not in handlers]:
        root.removeHandler(handler)
        handler.close()
    root.handlers, root.level = handlers, level


def folders(root: Path) -> list[Path]:
    """Return the folders of the runs below a folder, in order."""
    return sorted(path.parent for path in root.rglob("manifest.json"))


def test_a_run_writes_its_folder(run: Run, tmp_path: Path) -> None:
    """outputs/<verb>/<experiment>/<time> holds manifest, whole configuration and metrics."""
    assert run(*TINY, "seed=3") == 0
    (folder,) = folders(tmp_path)
    assert folder.relative_to(tmp_path).parts[:3] == ("outputs", "train", "nav2d")
    assert json.loads((folder / "manifest.json").read_text())["seed"] == 3
    assert yaml.safe_load((folder / "config.yaml").read_text())["algorithm"]["pairs"] == 2
    assert len((folder / "metrics.csv").read_text().splitlines()) == 2
    assert {path.name for path in (folder / ".hydra").iterdir()} >= {"overrides.yaml"}


JOBLIB = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=1"]


@pytest.mark.parametrize("launcher", [[], pytest.param(JOBLIB, marks=pytest.mark.slow)])
def test_a_sweep_numbers_its_folders(run: Run, tmp_path: Path, launcher: list[str]) -> None:
    """Jobs of a sweep lie in 0, 1, ... below one folder: names that need no quotes in a shell."""
    assert run("-m", *TINY, "seed=0,1", "policy=linear,mlp", *launcher) == 0
    found = folders(tmp_path)
    assert [folder.name for folder in found] == ["0", "1", "2", "3"]
    assert {folder.parent.parent for folder in found} == {tmp_path / "outputs" / "train" / "nav2d"}
    seeds = [json.loads((folder / "manifest.json").read_text())["seed"] for folder in found]
    assert seeds == [0, 0, 1, 1]
    assert all((folder / "metrics.csv").exists() for folder in found)


def test_a_value_that_a_job_cannot_have_ends_a_sweep_before_it_starts(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What a constructor refuses of any job is said before the first one runs."""
    small = ["+experiment=udr", "iterations=1", "eval=none", "frames=null"]
    assert run("-m", *small, "seed=0,1", "params.width=0.1,2") == 2
    assert "params.width=2" in capsys.readouterr().err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("launcher", [[], pytest.param(JOBLIB, marks=pytest.mark.slow)])
def test_a_failed_job_does_not_end_a_sweep(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], launcher: list[str]
) -> None:
    """The others run; a list at the end, in a file as well, names each failure with its job."""
    sweep = ["-m", *TINY, "algorithm.clean_final=[],[no]", "seed=0,1", "hydra.sweep.dir=all"]
    assert run(*sweep, *launcher) == 2
    trained = [path.parent.name for path in sorted(tmp_path.rglob("metrics.csv"))]
    assert trained == ["0", "1"]  # not 2 and 3
    title, *lines = capsys.readouterr().err.splitlines()[-3:]
    assert title == "sim2real: 2 of the sweep's jobs failed:"
    for number, line in enumerate(lines, start=2):
        assert re.match(rf"job {number} \(.*clean_final=\[no\].*\) failed: no parameter 'no'", line)
        assert line in (tmp_path / "all" / str(number) / "sim2real.log").read_text("utf-8")
    assert (tmp_path / "all" / "failed.txt").read_text("utf-8").splitlines() == lines
    assert run("-m", *TINY, "seed=2,3", "hydra.sweep.dir=all", "hydra.sweep.subdir=s${seed}") == 0


def fails_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every verb fail in this way."""

    def prepare(*_: Any) -> tuple[Any, dict[str, Any]]:
        def verb() -> None:
            raise error

        return verb, {}

    monkeypatch.setattr("sim2real.config.compose.instantiate", prepare)


def test_ctrl_c_is_one_line(run: Run, monkeypatch, capsys) -> None:
    """An interrupted run says so in a line and exits with 130."""
    fails_with(KeyboardInterrupt(), monkeypatch)
    assert run(*TINY) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "sim2real: interrupted"


def test_ctrl_c_ends_a_sweep_and_a_defect_does_not(run: Run, tmp_path, monkeypatch, capsys) -> None:
    """The traceback of a defect is in the job's log; every job is tried."""
    fails_with(KeyboardInterrupt(), monkeypatch)
    assert run("-m", *TINY, "seed=0,1", "hydra.sweep.dir=stopped") == 130
    assert len(folders(tmp_path / "stopped")) == 1
    fails_with(TypeError("a defect"), monkeypatch)
    assert run("-m", *TINY, "seed=0,1", "hydra.sweep.dir=broken") == 2
    assert capsys.readouterr().err.count("failed: TypeError: a defect") == 2
    for job in ("0", "1"):
        assert "Traceback" in (tmp_path / "broken" / job / "sim2real.log").read_text("utf-8")


def test_a_defect_shows_its_traceback(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """What no user can cause is not dressed up as a user's mistake."""
    fails_with(TypeError("a defect"), monkeypatch)
    with pytest.raises(TypeError, match="a defect"):
        run(*TINY)


def test_alone_it_says_what_it_can_do(run: Run, tmp_path: Path, capsys) -> None:
    """Without arguments nothing is trained and no folder is made; --version is this project's."""
    assert run() == 0
    assert "sim2real diagnose LOG.csv MODEL.xml" in capsys.readouterr().out
    assert run("--version") == 0
    assert capsys.readouterr().out.startswith("sim2real ")
    assert list(tmp_path.iterdir()) == []


def test_the_end_of_a_run_says_where_its_results_are(run: Run, tmp_path: Path) -> None:
    """What a person reads comes first; what every run has is left out."""
    for name in ("report.json", "report.html", "manifest.json", "sim2real.log", "config.yaml"):
        (tmp_path / name).touch()
    (tmp_path / "plots").mkdir()
    (tmp_path / ".hydra").mkdir()
    assert entry.made_in(tmp_path) == "report.html, plots/, report.json"
    assert run("record", "bench1", "seconds=1.0", "motions=[ramp]", "out=here") == 0
    said = (tmp_path / "here" / "sim2real.log").read_text(encoding="utf-8").splitlines()[-1]
    assert re.search("results are in .*here: log.csv, log.json, plots/", said)


def test_a_failed_run_says_why_in_its_log(run: Run, tmp_path: Path) -> None:
    """The sentence on the terminal stands in the run's log file too."""
    assert run(*TINY, "algorithm.num_rows=0") == 2
    (log,) = tmp_path.rglob("*.log")
    assert "num_rows=0" in log.read_text(encoding="utf-8").splitlines()[-1]


def test_a_refused_value_is_a_sentence(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    """A value that a constructor refuses ends the run with its sentence and status 2."""
    assert run(*TINY, "algorithm.num_rows=0") == 2
    assert "num_rows=0" in capsys.readouterr().err.splitlines()[-1]


def test_the_traceback_is_there_on_demand(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """HYDRA_FULL_ERROR=1 raises instead of saying a sentence."""
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(ConfigError):
        run("sed=1")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "this run: No space.*free some"),
        (PermissionError(errno.EACCES, "Permission denied", "/ro/x"), "/ro/x: Perm.*out=FOLDER"),
        (MemoryError("Unable to allocate 27 GiB"), "more memory than there is .Unable"),
        (ValueError("std::bad_alloc"), "more memory than there is"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory"), "more memory than there is"),
        (mujoco.FatalError("Could not allocate memory"), "more memory than there is"),
    ],
)
def test_what_a_machine_lacks_is_a_sentence(error: Exception, words: str) -> None:
    """A full disk, a folder that cannot be written and too little memory, in every verb."""
    assert re.search(words, str(entry.explained(error)))


def test_a_folder_that_cannot_be_made_is_a_sentence(run: Run, tmp_path: Path, capsys) -> None:
    """A file stands where the run's folder should be."""
    (tmp_path / "taken").touch()
    assert run(*TINY, "out=taken") == 2
    assert "taken: File exists" in capsys.readouterr().err


def test_broken_yaml_of_a_user_is_a_sentence(run: Run, tmp_path: Path, capsys) -> None:
    """With the file and the line."""
    (tmp_path / "mine" / "experiment").mkdir(parents=True)
    (tmp_path / "mine" / "experiment" / "bad.yaml").write_text("a: [1\n b: {")
    assert run("--config-dir", "mine", "+experiment=bad") == 2
    assert re.search(r"invalid YAML: .*bad\.yaml.*line 2", capsys.readouterr().err)
    (tmp_path / "mine" / "robot").mkdir()
    (tmp_path / "mine" / "robot" / "broken.yaml").write_text("rate: [1\n b: {")
    assert run("record", "robot=broken", "--config-dir", "mine") == 2
    assert re.search(r"invalid YAML: .*broken\.yaml.*line 2", capsys.readouterr().err)


@pytest.mark.parametrize("value", ["-1", "nan"])
def test_a_value_that_a_library_refuses_has_its_place(value: str, run: Run, capsys) -> None:
    """A learning rate below 0 is torch's to refuse; the key is ours to name."""
    small = ["+experiment=ppo_source", "iterations=1", "eval=none", "algorithm.num_rows=2"]
    assert run(*small, f"optimizer.lr={value}") == 2
    assert f"optimizer.lr={value}" in capsys.readouterr().err


def test_an_error_of_a_library_is_no_sentence() -> None:
    """A library's ValueError is a defect, and Python's in our lines; one that we raise is not."""
    with pytest.raises(ValueError) as theirs:
        json.loads("{")
    table = Table(("a",))
    table.rows.append((1, 2))
    with pytest.raises(ValueError, match="argument 2 is shorter") as python:
        table.csv()
    with pytest.raises(ValueError) as ours:
        check({"_target_": "os.system"}, "env")
    assert entry.explained(theirs.value) is None
    assert entry.explained(python.value) is None
    assert entry.explained(ours.value) == str(ours.value)


@pytest.mark.parametrize("program", ["sim2real", "hardware"])
def test_a_python_without_the_packages_says_which_to_use(program: str, tmp_path: Path) -> None:
    """One sentence with the interpreter and the remedy, where a first package is missing."""
    absent = "import sys; sys.modules['hydra'] = sys.modules['dynamixel_sdk'] = None"
    (tmp_path / "sitecustomize.py").write_text(absent, encoding="utf-8")
    path = f"{tmp_path}:{Path(entry.__file__).resolve().parents[1]}"
    words = [sys.executable, "-m", program, "record", "robot=bench1"]
    done = subprocess.run(
        words, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )
    assert done.returncode in (1, 2)
    assert re.search(r"python\S* has no package '.*': use .*\.venv/bin/python", done.stderr)
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_module_of_ours_that_is_missing_is_a_defect() -> None:
    """Nobody can install it."""
    assert entry.explained(ModuleNotFoundError("no", name="sim2real.verbs.none")) is None
    assert "[film]" in str(entry.explained(ModuleNotFoundError("no", name="PIL")))


@pytest.mark.parametrize(
    ("verb", "lost"),
    [
        ("record", "log.csv"),
        ("replay", "png"),
        pytest.param("diagnose", "report.html", marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_is_one_sentence_and_nothing_is_half_written(
    verb: str, lost: str, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No file can be larger than 7 kB: what does not fit is absent, and why is said.

    Rows of a recording that were written stay, as `log.csv.part`.
    """
    given = ["bench1", "seconds=2.0", "motions=[ramp]"]
    if verb != "record":
        (tmp_path / "arm.xml").write_text(arm.XML)
        given = [str(write_log(tmp_path / "arm.csv", arm.make_log(seconds=4.0))), "arm.xml"]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (7000, hard))
    try:
        assert run(verb, *given, "out=here") == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    (words,) = [w for w in capsys.readouterr().err.splitlines() if w.startswith("sim2real:")]
    assert re.search("File too large; free some space", words)
    there = [path.name for path in (tmp_path / "here").rglob("*") if path.is_file()]
    assert not [name for name in there if lost in name and not name.endswith(".part")]
    assert not [name for name in there if name.startswith(".") and name != ".hydra"]


def test_a_log_file_on_a_full_disk_is_no_traceback(run: Run, monkeypatch, capsys) -> None:
    """What does not fit into the run's own log is left out; the next other file says why."""

    def full(self: logging.FileHandler, record: logging.LogRecord) -> None:
        self.handleError(record)

    monkeypatch.setattr(logging, "raiseExceptions", True)  # put back afterwards
    monkeypatch.setattr(logging.FileHandler, "emit", full)
    assert run("record", "bench1", "seconds=1.0", "motions=[ramp]") == 0
    assert "Logging error" not in capsys.readouterr().err


def test_a_page_is_viewed_without_a_run(run: Run, tmp_path: Path, monkeypatch, capsys) -> None:
    """`view PAGE.html` opens the file, makes no folder, and takes one page alone."""
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: bool(opened.append(url)) or True)
    (tmp_path / "report.html").touch()
    assert run("view", "report.html") == 0
    assert opened == [(tmp_path / "report.html").as_uri()]
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert run("view", "report.html", "seed=1") == 2
    assert run("view", "other.html") == 2
    assert "no page other.html" in capsys.readouterr().err
    assert len(opened) == 1
