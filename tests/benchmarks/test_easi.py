"""EASI's study does each step once, in order, and says what it found; demonstrations are whole."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.cases import read_csv
from benchmarks.easi import steps
from benchmarks.easi.__main__ import main
from benchmarks.easi.demonstrations import record
from benchmarks.easi.plan import SHIFTS, STUDIES, Plan, targets, truth
from benchmarks.easi.steps import LOG, prior
from envs.distribution import Distribution, Entry
from envs.distribution_file import read, write
from envs.effects import make
from envs.marginals import Marginal
from envs.simulation import Simulation
from envs.tasks import CartPole
from hardware.log import Log
from sim2real.identification.outcome import FILE

pytestmark = pytest.mark.slow  # trainings and walks: a minute together

LEVELS = {"udr": 160.0, "oracle": 185.0, "easi_200": 180.0, "narrow": 150.0, "point": 179.0}
SIMULATED = [name for name in STUDIES if name != "quad8"]  # whose targets are simulated, too
LEVELS |= {"tuned": 170.0}
PRIOR = Distribution(
    (Entry(make("position_gain", where="slider"), (Marginal("uniform", 1.6, 0.7, 0.33, 3.0),)),)
)
FOUND = Distribution(
    (Entry(make("position_gain", where="slider"), (Marginal("normal", 1.1, 0.2, 0.33, 3.0),)),)
)


class Shell:
    """Stands for trainings and identifications: remembers them and leaves their files."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[dict[str, str]] = []
        self.fails: set[str] = set()
        self.targets: list[str] = []
        monkeypatch.setattr(steps, "sim2real", self.run)
        monkeypatch.setattr(steps, "trained", lambda folder: 0)
        monkeypatch.setattr(steps, "demonstrate", self.demonstrate)
        monkeypatch.setattr(steps, "prior", lambda plan: PRIOR)
        monkeypatch.setattr("benchmarks.easi.report.prior", lambda plan: PRIOR)

    def demonstrate(self, policy: Path, count: int, seed: int, path: Path, effects: Any) -> Path:
        """Leave an empty log."""
        self.targets += [str(effects)] if effects else []
        path.write_text("")
        return path

    def run(self, *arguments: str) -> bool:
        """Train or identify."""
        given = dict(argument.split("=", 1) for argument in arguments)
        self.jobs.append(given)
        folder = Path(given["hydra.run.dir"])
        folder.mkdir(parents=True, exist_ok=True)
        if folder.name in self.fails:
            return False
        if given.get("run") == "identify":
            write(folder / FILE, FOUND)
            points = {f"asked.{i}": np.full((4, 1), 1.0 + 0.1 * i) for i in range(3)}
            np.savez(folder / "journal.npz", allow_pickle=False, **points)
            return True
        level = LEVELS[folder.name] + int(given["seed"])
        robots = {"target": {"changes": {}, "returns": [level], "lengths": [200], "failed": 0}}
        about = {"name": "x", "task": "CartPole", "trained_on": "target", "training_steps": 1000}
        document = {"schema": 1, "seed": 0, "runs": [{**about, "robots": robots}]}
        (folder / "transfer-1000.json").write_text(json.dumps(document))
        return True


def go(tmp_path: Path, *words: str) -> int:
    """Run the study into folders of the test."""
    places = ["--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]
    return main([*words, *places])


def test_each_step_is_done_once_and_in_order(tmp_path, monkeypatch) -> None:
    """UDR's policy comes first, then what needs it; a second call does nothing."""
    shell = Shell(monkeypatch)
    rows = ("--rows", "easi_200", "narrow", "point", "udr", "oracle", "--seeds", "0", "1")
    assert go(tmp_path, *rows) == 0
    names = [Path(job["hydra.run.dir"]).name for job in shell.jobs]
    first = ["udr", "oracle", "identify_easi_200", "easi_200"]
    assert names == first * 2 + ["narrow", "point"] * 2
    found = {Path(job["hydra.run.dir"]).name: job for job in shell.jobs}
    assert found["oracle"]["params"] == "none"
    assert found["easi_200"]["params"] == "distribution"
    assert found["point"]["effects"].endswith(f"identify_easi_200/{FILE}")
    assert Path(found["identify_easi_200"]["log"]).name == LOG
    narrow = read(found["narrow"]["params.path"])
    assert (narrow.mean[0], narrow.std[0]) == (pytest.approx(1.6), pytest.approx(0.2))
    assert go(tmp_path, *rows) == 0
    assert len(shell.jobs) == len(names)
    line = read_csv(tmp_path / "results" / "easi.csv")[0]
    assert (line["row"], line["seed"], line["value"]) == ("easi_200", "0", "180")
    page = (tmp_path / "results" / "easi_cartpole.md").read_text()
    assert "182.9 ± 4.3" in page
    assert "holds, few seeds: EASI above uniform randomization, by 20.0" in page
    assert "holds, few seeds: EASI at least 0.95 of the oracle, by 4.3" in page
    assert "holds, few seeds: EASI above its own width elsewhere, by 30.0" in page
    assert (tmp_path / "results" / "easi_cartpole.png").stat().st_size > 1000


def test_fine_tuning_goes_on_from_uniform_randomization(tmp_path, monkeypatch) -> None:
    """On the target, for the steps of 200 trajectories; not without a policy."""
    shell = Shell(monkeypatch)
    assert go(tmp_path, "--rows", "tuned", "--seeds", "0") == 1
    assert go(tmp_path, "--rows", "udr", "tuned", "--seeds", "0") == 0
    job = shell.jobs[-1]
    assert (job["params"], job["frames"]) == ("none", str(1000 + 200 * CartPole().max_steps))
    assert Path(job["start"]).name == "udr"


def test_another_target_is_identified_anew(tmp_path, monkeypatch) -> None:
    """One training of UDR for all targets; the rest is of, and judged on, the target's effects."""
    shell = Shell(monkeypatch)
    words = ("--target", "far", "--rows", "udr", "oracle", "easi_200", "--seeds", "0")
    assert go(tmp_path, *words) == 0
    udr, there, oracle, easi, last = shell.jobs
    far = str(SHIFTS / "cartpole_far.yaml")
    assert "cartpole/seed0/udr" in udr["hydra.run.dir"] and "+eval.robots.target.effects" not in udr
    assert (there["run"], there["checkpoint"]) == ("evaluate", udr["hydra.run.dir"])
    assert "cartpole_far/seed0/udr" in there["hydra.run.dir"]
    assert (oracle["params"], oracle["effects"]) == ("none", far)
    assert shell.targets == [far]
    before = read(easi["params.path"])
    assert (before.low[0], before.high[0]) == (pytest.approx(0.33), 3.0)
    assert "effects" not in easi and "effects" not in last
    assert all(j["+eval.robots.target.effects"] == far for j in (there, oracle, last))
    assert go(tmp_path, *words) == 0
    assert len(shell.jobs) == 5
    tasks = {line["task"] for line in read_csv(tmp_path / "results" / "easi.csv")}
    assert tasks == {"cartpole_far"}
    page = (tmp_path / "results" / "easi_cartpole_far.md").read_text()
    assert "--target far" in page and "182.9" not in page  # the seed's figures are of its own


def test_a_target_that_is_not_there_is_refused(tmp_path, capsys) -> None:
    """With those that are."""
    with pytest.raises(SystemExit):
        go(tmp_path, "--target", "fat")
    assert "cartpole has no such target; it has: far, soft" in capsys.readouterr().err


def test_what_failed_is_tried_again(tmp_path, monkeypatch) -> None:
    """Without UDR's policy nothing is identified; the next call makes up for it."""
    shell = Shell(monkeypatch)
    shell.fails = {"udr"}
    assert go(tmp_path, "--rows", "udr", "easi_200", "--seeds", "0") == 1
    assert len(shell.jobs) == 1
    shell.fails = set()
    assert go(tmp_path, "--rows", "udr", "easi_200", "--seeds", "0") == 0
    assert len(shell.jobs) == 4


def test_demonstrations_are_whole_episodes_of_the_target() -> None:
    """Each row's state goes into the next; an episode that falls is followed by another."""
    rows = Simulation(CartPole(max_steps=60), 3, threads=1)
    push = np.array([[1.0], [-1.0], [0.0]])
    log = Log(record(rows, lambda seen: push, seed=0))
    assert len(list(log.episodes())) > 3
    assert sum(len(part) - 1 for part in log.episodes()) == 3 * 60
    part = next(iter(log.episodes()))
    again = Simulation(CartPole(), 1, threads=1)
    again.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64))
    start = [
        [part.column(f"{kind}.{name}")[0] for name in ("slider", "hinge")]
        for kind in ("qpos", "qvel")
    ]
    again.set_state(np.arange(1), np.array(start[:1]), np.array(start[1:]))
    for row in range(1, len(part)):
        seen = again.step(None, part.column("action.0")[row - 1].reshape(1, 1)).observation[0]
        np.testing.assert_allclose(seen, [part.column(f"obs.{i}")[row] for i in range(4)])
    np.testing.assert_allclose(part.column("ctrl.slider"), 0.2 * part.column("action.0"))


def test_the_target_is_the_robot_as_its_model_says() -> None:
    """Factors of 1, and the task's own limit on the speed."""
    plan = Plan("cartpole", (), (), Path(), Path())
    target = truth(plan, prior(plan).effects)
    assert target.pop("torque_speed_knee.slider") == 0.48
    assert set(target.values()) == {1.0}
    assert len(target) == 10


@pytest.mark.parametrize(("task", "name"), [(t, n) for t in SIMULATED for n in targets(t)])
def test_a_target_lies_in_the_prior_that_easi_is_given(task: str, name: str) -> None:
    """Also where randomization does not reach; its values are those of its file."""
    plan = Plan(task, (), (), Path(), Path(), target=name)
    before = prior(plan)
    values = np.array([truth(plan, before.effects)[n] for n in before.names])
    inside = (values >= before.low) & (values <= before.high) | np.isnan(values)
    if name != "bare":  # a target without friction and without limits
        assert inside.all()
        home = prior(plan.home)
        assert ((values < home.low) | (values > home.high)).any()
