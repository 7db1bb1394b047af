"""EASI on quad8: walks on the emulated robot, each once and in order; joints as they answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.easi import quad8, quad8_report, response
from benchmarks.easi.__main__ import main
from benchmarks.easi.plan import SHIFTS, Plan, truth
from benchmarks.easi.quad8_report import gain, lag
from benchmarks.easi.report import read_csv
from benchmarks.easi.response import Answer, apart, measured, played, tracking
from benchmarks.easi.steps import prior
from envs.distribution import Distribution
from envs.distribution_file import write
from sim2real.identification.outcome import FILE

LEVELS = {"udr": 0.5, "oracle": 0.9, "easi_200": 0.85}
RATE, ROWS = 50.0, 2000


class Shell:
    """Stands for trainings, identifications and walks: remembers them and leaves their files."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[str] = []
        self.given: dict[str, dict[str, str]] = {}
        monkeypatch.setattr(quad8, "sim2real", self.run)
        monkeypatch.setattr("benchmarks.easi.steps.sim2real", self.run)
        monkeypatch.setattr(quad8, "trained", lambda folder: 0)
        monkeypatch.setattr(quad8, "record", lambda robot, folder, seed: None)
        monkeypatch.setattr(quad8, "walked", self.walk)
        monkeypatch.setattr(quad8_report, "find", lambda folder: folder)
        monkeypatch.setattr(quad8_report, "read_metadata", lambda folder: {"frames": 100})

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
        "udr",
        "udr walks 10 for udr",
        "oracle",
        "oracle walks 10 for oracle",
        "udr walks 200 for demonstrations_200",
        "identify_easi_200",
        "easi_200",
        "easi_200 walks 10 for easi_200",
        "udr",
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


def test_the_response_of_a_late_and_weak_joint() -> None:
    """Half of the command two rows late: a gain of a half, and a lag that grows with frequency."""
    rng = np.random.default_rng(0)
    command = np.cumsum(rng.normal(0.0, 0.05, (ROWS, 2)), axis=0)
    late = np.vstack([np.zeros((2, 2)), command[:-2]])
    frequency, shown = response.response(Answer(command, np.stack([command, 0.5 * late]), RATE))
    np.testing.assert_allclose(shown[0], 1.0, atol=1e-9)
    np.testing.assert_allclose(gain(shown[1]), 0.5, atol=0.03)
    np.testing.assert_allclose(lag(shown[1]), 360.0 * frequency * 2 / RATE, atol=4.0)


@pytest.mark.slow
def test_the_stand_tells_the_robot_from_its_model(tmp_path: Path) -> None:
    """Simulated with what the robot hides, its joints answer as they did; as given, not at all."""
    plan = Plan("quad8", (), (), tmp_path, tmp_path, target="servos")
    response.record(quad8.robot(plan), tmp_path / "stand", 0)
    before: Distribution = prior(plan.home)
    real = measured(tmp_path / "stand")
    gaps, off = {}, {}
    for name, where in {"hidden": plan, "given": plan.home}.items():
        told = truth(where, before.effects)
        values = np.array([[told[one] for one in before.names]])
        one = played(tmp_path / "stand", before.effects, values)
        gaps[name], off[name] = apart(real, one)[0], tracking(real, one)[0]
    assert off["hidden"] < 0.003 and gaps["hidden"] < 0.01
    assert off["given"] > 0.05 and gaps["given"] > 0.3


def test_what_quad8_has_not_is_refused(capsys: pytest.CaptureFixture) -> None:
    """Targets that are no file of conf/shift, and rows that are of simulated targets alone."""
    with pytest.raises(SystemExit):
        main(["--task", "quad8", "--rows", "tuned"])
    assert "--rows tuned: quad8 has: udr, oracle, easi_1" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--task", "quad8", "--target", "iced"])
    assert "quad8 has no such target; it has: low_friction, servos" in capsys.readouterr().err
