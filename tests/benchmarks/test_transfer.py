"""The long transfer study does each run once, the most telling first, and can be interrupted."""

from pathlib import Path

import pytest

from benchmarks import pixels, study
from benchmarks.study import Plan, folder_lock, run
from benchmarks.transfer import MAIN, ROUNDS, STUDY


class Shell:
    """Stands for the command line: remembers the jobs and leaves the files that they would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[tuple[str, ...]] = []
        self.steps: dict[Path, int] = {}
        self.fails: set[str] = set()
        monkeypatch.setattr(study, "sim2real", self.run)
        monkeypatch.setattr(study, "trained", lambda folder: self.steps.get(folder, 0))

    def run(self, *arguments: str) -> bool:
        """Do a job."""
        self.jobs.append(arguments)
        given = dict(a.split("=", 1) for a in arguments)
        folder = Path(given["hydra.run.dir"])
        folder.mkdir(parents=True, exist_ok=True)
        if given.get("run") == "report":
            (folder / "report.md").write_text("a report\n", encoding="utf-8")
        elif given["+experiment"] in self.fails:
            return False
        else:
            self.steps[folder] = int(given["frames"]) + 7
            (folder / f"transfer-{self.steps[folder]}.json").write_text("{}", encoding="utf-8")
        return True

    @property
    def trainings(self) -> list[dict[str, str]]:
        """What was trained, in order."""
        jobs = [dict(a.split("=", 1) for a in job) for job in self.jobs]
        return [job for job in jobs if "+experiment" in job]


def plan(tmp_path: Path, rows: tuple[str, ...], seeds: tuple[int, ...] | None = (0,)) -> Plan:
    """Return a plan in a folder of its own."""
    return Plan(ROUNDS, rows, seeds, tmp_path / "runs", tmp_path / "results")


def test_the_most_telling_runs_come_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All main rows of seed 0, then of seed 1; the sweeps once ten seeds of these are done."""
    shell = Shell(monkeypatch)
    assert run(plan(tmp_path, tuple(STUDY.rows), None)) == 0
    order = [(t["+experiment"], t["seed"]) for t in shell.trainings if "resume" not in t]
    names = [row.experiment for row in MAIN]
    assert order[:8] == [(name, "0") for name in names] + [(name, "1") for name in names]
    assert len(order) == sum(row.seeds for row in STUDY.rows.values()) == len(set(shell.steps))
    assert order.index(("udr", "9")) < order.index(("ppo_gamma07", "0"))
    assert (tmp_path / "results" / "report.md").read_text() == "a report\n"


def test_a_main_run_is_evaluated_on_its_way(tmp_path: Path, monkeypatch) -> None:
    """After 300k, where the sweep ends, and then it goes on to 500k in the same folder."""
    shell = Shell(monkeypatch)
    run(plan(tmp_path, ("udr",)))
    first, second = shell.trainings
    assert (first["frames"], second["frames"]) == ("300000", "500000")
    assert "resume" not in first and second["resume"] == second["hydra.run.dir"]
    assert first["params.width"] == second["params.width"] == "0.075"


def test_what_is_done_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second call trains nothing; a run without its evaluation is taken up at its end."""
    shell = Shell(monkeypatch)
    run(plan(tmp_path, ("ndr",)))
    run(plan(tmp_path, ("ndr",)))
    assert len(shell.trainings) == 1
    for file in (tmp_path / "runs").rglob("transfer-*.json"):
        file.unlink()
    run(plan(tmp_path, ("ndr",)))
    assert shell.trainings[1]["frames"] == "500007"


def test_one_failure_does_not_stop_the_others(tmp_path: Path, monkeypatch) -> None:
    """The rest is run and the number of failures returned, so that the exit status tells."""
    shell = Shell(monkeypatch)
    shell.fails.add("ppo_source")
    assert run(plan(tmp_path, ("source", "ndr"))) == 1
    assert [t["+experiment"] for t in shell.trainings] == ["ppo_source", "ndr"]


def test_programs_share_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that another program holds is left to it."""
    shell, mine = Shell(monkeypatch), plan(tmp_path, ("source", "ndr"))
    with folder_lock(mine.folder(STUDY.rows["source"], 0)) as free:
        assert free
        run(mine)
    assert [t["+experiment"] for t in shell.trainings] == ["ndr"]
    run(mine)
    assert shell.trainings[-1]["+experiment"] == "ppo_source"


def test_unknown_rows_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """The answer lists what there is."""
    with pytest.raises(SystemExit):
        STUDY.main(["--rows", "sourc"])
    assert "no row 'sourc'; there are: source, target" in capsys.readouterr().err


def test_a_longer_row_goes_on_where_a_shorter_one_ended(tmp_path: Path, monkeypatch) -> None:
    """Half a million steps with images are the first hundred thousand and then the others."""
    shell = Shell(monkeypatch)
    names = ("stack4", "stack4_long")
    run(Plan(pixels.STUDY.rounds, names, (0,), tmp_path / "runs", tmp_path / "results"))
    first, second = shell.trainings
    assert (first["frames"], second["frames"]) == ("100000", "500000")
    assert second["resume"] == first["hydra.run.dir"]
