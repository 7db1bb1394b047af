"""EASI on quad8: walks on the emulated robot, each once and in order."""

from pathlib import Path

import pytest

from benchmarks.cases import read_csv
from benchmarks.easi import quad8, report
from benchmarks.easi.__main__ import main
from benchmarks.easi.plan import SHIFTS, Plan
from benchmarks.easi.steps import prior
from envs.distribution_file import write
from sim2real.identification.outcome import FILE

LEVELS = {"udr": 0.5, "oracle": 0.9, "easi_200": 0.85}


class Shell:
    """Stands for trainings, identifications and walks: remembers them and leaves their files."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[str] = []
        self.given: dict[str, dict[str, str]] = {}
        monkeypatch.setattr(quad8, "sim2real", self.run)
        monkeypatch.setattr("benchmarks.easi.steps.sim2real", self.run)
        monkeypatch.setattr(quad8, "trained", lambda folder: 0)
        monkeypatch.setattr(quad8, "walked", self.walk)
        monkeypatch.setattr(report, "find", lambda folder: folder)
        monkeypatch.setattr(report, "read_metadata", lambda folder: {"frames": 100})

    def run(self, *arguments: str) -> bool:
        """Train or identify."""
        given = dict(argument.split("=", 1) for argument in arguments)
        folder = Path(given["hydra.run.dir"])
        folder.mkdir(parents=True, exist_ok=True)
        if given.get("run") == "identify":
            write(folder / FILE, prior(Plan("quad8", (), (), Path(), Path())))
        name = folder.name if folder.name != "policy" else folder.parent.name
        self.jobs.append(name)
        self.given[name] = given
        return True

    def walk(self, plan: Plan, policy: Path, folder: Path, episodes: int, seed: int) -> bool:
        """Walk."""
        if (folder / "table.csv").is_file():
            return True
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "table.csv").write_text("")
        value = LEVELS.get(folder.parent.name, 0.0) + 0.01 * seed
        (folder / "returns.csv").write_text(f"phase,return\nas trained,{value}\n")
        name = folder.parent.name if folder.name == "bus" else folder.name
        self.jobs.append(f"{policy.parent.name} walks {episodes} for {name}")
        return True


@pytest.mark.slow
def test_each_step_is_done_once_and_in_order(tmp_path: Path, monkeypatch) -> None:
    """The randomized policy walks first; EASI is given its walks, and training what it found."""
    shell = Shell(monkeypatch)
    places = ["--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]
    words = ["--task", "quad8", "--rows", "udr", "oracle", "easi_200", "--seeds", "0", "1", *places]
    assert main(words) == 0
    assert shell.jobs[:9] == [
        *("udr", "udr walks 10 for udr", "oracle", "oracle walks 10 for oracle"),
        *("udr walks 200 for demonstrations_200", "identify_easi_200", "easi_200"),
        *("easi_200 walks 10 for easi_200", "udr"),
    ]
    assert shell.given["udr"]["params"] == "quad8_servos" and "effects" not in shell.given["udr"]
    assert shell.given["oracle"]["effects"] == str(SHIFTS / "quad8_servos.yaml")
    assert shell.given["identify_easi_200"]["log"].endswith("demonstrations_200/logs")
    assert shell.given["easi_200"]["params.path"].endswith(f"identify_easi_200/{FILE}")
    assert main(words) == 0
    assert len(shell.jobs) == 16
    line = read_csv(tmp_path / "results" / "easi.csv")[0]
    assert (line["task"], line["row"], line["value"]) == ("quad8_servos", "easi_200", "0.85")
    page = (tmp_path / "results" / "easi_quad8_servos.md").read_text()
    assert "holds, few seeds: EASI above uniform randomization, by 0.35" in page
    assert "0.78 ± 0.02" in page and "position_gain" in page


def test_what_quad8_has_not_is_refused(capsys: pytest.CaptureFixture) -> None:
    """Targets that are no file of conf/shift, and rows that are of simulated targets alone."""
    with pytest.raises(SystemExit):
        main(["--task", "quad8", "--rows", "tuned"])
    assert "--rows tuned: quad8 has: udr, oracle, easi_1" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--task", "quad8", "--target", "iced"])
    assert "quad8 has no such target; it has: low_friction, servos" in capsys.readouterr().err
