"""The study of servo robots does each job once, goes on where it stopped, says what it found."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import robots
from benchmarks.robots import MORE, SHIFTS, TRAININGS, Plan, collect, cpu_minutes, main, run
from benchmarks.robots_report import Figures, claims, page, write
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.tables import Table

LEVELS = {"servo": 1.0, "ideal": 0.8, "esmaml": 0.9, "ppo": 0.95}  # of returns in `servo`
WORLDS = {"ideal": 1.1, "servo": 1.0}


class Shell:
    """Stands for trainings and deployments: remembers them and leaves the files that they would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[dict[str, str]] = []
        self.rides: list[dict[str, str]] = []
        self.fails: set[str] = set()
        monkeypatch.setattr(robots, "sim2real", self.train)
        monkeypatch.setattr(robots, "trained", lambda folder: int((folder / "part").is_file()))
        monkeypatch.setattr(robots, "find", lambda folder: folder)
        monkeypatch.setattr(robots, "read_metadata", lambda folder: {"iteration": 40})
        monkeypatch.setattr(
            robots, "instantiate", lambda words, out: (self.ride, {"words": words, "o": out})
        )
        monkeypatch.setattr(robots, "compose", lambda words: words)

    def train(self, *arguments: str) -> bool:
        """Train and evaluate, or leave a part of it."""
        given = dict(a.split("=", 1) for a in arguments)
        self.jobs.append(given)
        folder = Path(given["hydra.run.dir"])
        folder.mkdir(parents=True, exist_ok=True)
        if folder.name in self.fails:
            (folder / "part").write_text("")
            return False
        level = LEVELS[folder.name] + 0.01 * int(given["seed"])
        found = {
            world: {"changes": {}, "returns": [level * scale], "lengths": [150], "failed": 0}
            for world, scale in WORLDS.items()
        }
        about = {"name": "x", "task": "Quad8", "trained_on": None, "training_steps": 1000}
        document = {"schema": 1, "seed": 0, "runs": [{**about, "robots": found}]}
        (folder / "transfer-1000.json").write_text(json.dumps(document))
        return True

    def ride(self, words: list[str], o: Path) -> None:
        """Run on the bus: 0.98 of the return, 0.4 with a shift, 0.7 after adapting to it."""
        given = dict(a.split("=", 1) for a in words)
        self.rides.append(given)
        if o.name in self.fails:
            raise Sim2RealError("the bus is on fire")
        o.mkdir(parents=True)
        level = LEVELS[Path(given["checkpoint"]).name] + 0.01 * int(given["seed"])
        rows = Table(("phase", "episode", "return"))
        rows.add("as trained", 1, level * (0.4 if "robot.hidden" in given else 0.98))
        if "robot.hidden" in given:
            rows.add("adapting", 1, 0.0)
            rows.add("adapted", 1, level * 0.7)
        (o / "returns.csv").write_text(rows.csv())
        (o / "table.csv").write_text("")


def plan(
    tmp_path: Path, names: tuple[str, ...] = ("quad8",), seeds: tuple[int, ...] = (0,)
) -> Plan:
    """Return a plan in a folder of its own."""
    return Plan(names, seeds, tmp_path / "runs", tmp_path / "results")


@pytest.mark.slow
def test_each_policy_is_trained_and_taken_to_the_bus(tmp_path: Path, monkeypatch) -> None:
    """Four trainings, each on the bus, ES-MAML's also on two robots that differ; PPO comes last."""
    shell = Shell(monkeypatch)
    assert run(plan(tmp_path, ("quad8", "hopper2"), (0, 1))) == 0
    order = [(j["+experiment"], j["seed"]) for j in shell.jobs]
    assert order[:4] == [*[("quad8_es", "0")] * 2, ("quad8_esmaml", "0"), ("quad8_es", "1")]
    assert {name for name, _ in order[-4:]} == {"quad8_ppo", "hopper2_ppo"}
    assert len(order) == 2 * 2 * len(TRAININGS)
    assert len(shell.rides) == 2 * 2 * (len(TRAININGS) + 2)
    adapting = [ride for ride in shell.rides if "robot.hidden" in ride]
    assert all(ride["adapt"] == "batch" for ride in adapting)
    rounds = int(adapting[0]["adapt.queries"]) * int(adapting[0]["adapt.parallel"])
    assert rounds + 1 == 50  # and the policy's own episode
    shifts = {Path(ride["robot.hidden"]).stem for ride in adapting}
    assert shifts == {name for of_robot in SHIFTS.values() for name in of_robot.values()}


@pytest.mark.slow
def test_meta_learning_goes_on_from_the_walking_policy(tmp_path: Path, monkeypatch) -> None:
    """It resumes that run for MORE iterations, and itself once it has begun; not without it."""
    shell = Shell(monkeypatch)
    shell.fails = {"esmaml"}
    here = plan(tmp_path)
    assert run(here) == 1
    (first,) = [job for job in shell.jobs if job["+experiment"] == "quad8_esmaml"]
    assert first["resume"] == str(here.folder("quad8", 0, "servo"))
    assert first["iterations"] == str(40 + MORE)
    shell.fails.clear()
    assert run(here) == 0
    assert shell.jobs[-1]["resume"] == str(here.folder("quad8", 0, "esmaml"))
    shell.fails = {"servo"}
    assert run(plan(tmp_path, seeds=(1,))) == 2
    assert not here.folder("quad8", 1, "bus_esmaml").exists()


def test_what_is_done_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second call trains nothing; a ride that failed is repeated."""
    shell = Shell(monkeypatch)
    shell.fails = {"bus_ideal"}
    assert run(plan(tmp_path)) == 1
    shell.fails.clear()
    shell.jobs.clear()
    shell.rides.clear()
    assert run(plan(tmp_path)) == 0
    assert (len(shell.jobs), len(shell.rides)) == (0, 1)
    assert cpu_minutes(plan(tmp_path).folder("quad8", 0, "servo")) >= 0


@pytest.mark.slow
def test_the_page_holds_the_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Medians over seeds with intervals, each claim with its answer, a picture and all numbers."""
    Shell(monkeypatch)
    run(plan(tmp_path, ("quad8", "hopper2"), (0, 1, 2)))
    collect(plan(tmp_path, seeds=(0, 1, 2)))
    text = (tmp_path / "results" / "robots.md").read_text(encoding="utf-8")
    assert "`servo`, ES | 0.98 [0.98, 0.98] | >= 0.9 | 3 | holds |" in text
    assert "of its own return | 0.11 [0.11, 0.11] | >= 0.15 | 3 | fails |" in text
    assert "| quad8 | low friction | 3 | 1 | 0.89 [0.88, 0.90] |" in text
    share = (0.7 - 0.4) / (0.98 - 0.4)
    assert f"recovered by adapting on the bus | {share:.2f}" in text
    rows = (tmp_path / "results" / "robots.csv").read_text(encoding="utf-8")
    assert "quad8,2,ppo.on_bus,0.950" in rows
    assert (tmp_path / "results" / "robots.png").stat().st_size > 10_000


def test_a_shift_that_costs_nothing_has_nothing_to_recover() -> None:
    """Such a seed does not count, and seeds without figures do not either."""
    seed = {"esmaml.on_bus": 1.0, "load.before": 0.98, "load.after": 0.5, "load.episodes": 50.0}
    found: Figures = {"quad8": {0: seed, 1: {**seed, "load.before": 0.5, "load.after": 0.7}, 2: {}}}
    table = claims(found)
    (row,) = table.rows
    assert row[2] == pytest.approx(0.4) and row[4:] == (1, "holds")
    assert "Adapting" in page(found)


def test_a_wrong_seed_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """With a sentence; and a report of nothing writes nothing."""
    with pytest.raises(SystemExit):
        main(["--seeds", "-1"])
    assert "--seeds: -1 must be at least 0" in capsys.readouterr().err
    assert main(["--report", "--out", str(tmp_path), "--results", str(tmp_path / "r")]) == 0
    assert not (tmp_path / "r").exists()


def test_every_figure_is_finite_in_the_listing(tmp_path: Path) -> None:
    """robots.csv is what the tables are made of."""
    write({"quad8": {0: {"servo.in_servo": 1.25}}}, tmp_path)
    (line,) = (tmp_path / "robots.csv").read_text("utf-8").splitlines()[1:]
    assert line.split(",")[:3] == ["quad8", "0", "servo.in_servo"]
    assert np.isfinite(float(line.split(",")[3]))
