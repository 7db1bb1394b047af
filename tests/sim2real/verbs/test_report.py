"""The report puts runs into the tables that it names, with the study's figures beside them."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from sim2real.config.catalogue import CONF, options
from sim2real.config.compose import ConfigError, compose
from sim2real.evaluation import report
from sim2real.evaluation.hypotheses import Claim
from sim2real.evaluation.study import Study, collect
from sim2real.evaluation.study_plots import Pictures
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs import report as verb
from tests.sim2real.made_runs import make_run
from tests.sim2real.trained import run_verb

EXPECT: dict[str, Any] = {
    "figures": [{"when": {"params.width": 0.1}, "target": [1470.0, 72.0]}],
    "claims": [
        {
            "claim": "a tenth helps",
            "left": {"experiment": "udr", "when": {"params.width": 0.1}, "robot": "target"},
            "is": "above",
            "right": {"experiment": "ppo_source", "robot": "target"},
            "seeds": 5,
        }
    ],
}


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Five seeds of the two bounds and of two widths."""
    for seed in range(5):
        make_run(tmp_path, "ppo_source", seed, (1500 + seed, 1000 + seed))
        make_run(tmp_path, "ppo_target", seed, (900 + seed, 1600 + seed), trained_on="target")
        for width in (0.1, 0.5):
            more = {"params": {"width": width}, "expect": EXPECT}
            make_run(tmp_path, "udr", seed, (1400 + seed, 1300 + seed - 1000 * width), **more)
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few resamples."""
    monkeypatch.setattr(report, "DRAWS", 200)
    monkeypatch.setattr(verb, "DRAWS", 200)


def rows(path: Path) -> list[dict[str, str]]:
    """Read a CSV."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.usefixtures("quick")
def test_everything_that_it_promises_is_there(runs: Path, tmp_path: Path) -> None:
    """Tables, verdicts and pictures, from the command's own arguments."""
    out = tmp_path / "report"
    (verdict,) = run_verb(["run=report", f"runs={runs}"], out)
    assert (verdict.verdict, verdict.claim.text) == ("held", "a tenth helps")
    page = (out / "report.md").read_text(encoding="utf-8")
    titles = [line for line in page.splitlines() if line.startswith("## ")]
    assert titles[1:] == [
        f"## {a} → {b}" for a in ("source", "target") for b in ("source", "target")
    ]
    assert "| a tenth helps | held | P = 1.00 [1.00, 1.00]; IQM 1202 against 1002 |" in page
    assert page.index("| ppo_source |") < page.index("| ppo_target |") < page.index("| udr width")
    for picture in ("plots/sweep_udr.png", "plots/learning_curves_robots.png"):
        assert f"({picture})" in page and (out / picture).stat().st_size > 5000
    assert len(rows(out / "returns.csv")) == 20 * 2
    assert len(rows(out / "claims.csv")) == 1


@pytest.mark.usefixtures("quick")
def test_rows_say_what_runs_got_and_what_the_study_got(runs: Path) -> None:
    """A width's own figure, its interquartile mean, and how it compares with the baseline."""
    study = Study(collect([runs]))
    table = report.Report(study, "ppo_source", 0).long_table()
    found: dict[Any, dict[str, Any]]
    found = {(row[0], row[2]): dict(zip(table.columns, row, strict=True)) for row in table.rows}
    tenth = found["udr width=0.1", "target"]
    assert tenth["runs"] == 5 and tenth["study mean"] == 1470 and tenth["IQM"][0] == 1202
    assert tenth["sd over runs"] == pytest.approx(np.std(range(5), ddof=1))
    assert tenth["sd over episodes"] == pytest.approx(2**0.5)
    assert tenth["P(improvement)"][0] == 1.0
    half = found["udr width=0.5", "target"]
    assert half["study mean"] is None and half["P(improvement)"][0] == 0.0
    assert found["ppo_source", "target"]["P(improvement)"] is None


@pytest.mark.usefixtures("quick")
def test_a_single_run_has_no_interval(tmp_path: Path) -> None:
    """It is shown with its value alone, and compared with nothing."""
    make_run(tmp_path, "ppo_source", 0, (1500, 1000))
    study = Study(collect([tmp_path]))
    (row,) = report.Report(study, "ppo_source", 0).main_table().rows
    assert list(row) == ["ppo_source", "source", 1, 500_000, 1500, 1000, None, None, None]


@pytest.mark.usefixtures("quick")
def test_a_baseline_is_compared_after_the_same_steps(tmp_path: Path) -> None:
    """Runs that ended earlier are not compared with longer ones."""
    for seed in range(2):
        make_run(tmp_path, "ppo_source", seed, (1, 1000))
        make_run(tmp_path, "udr", seed, (1, 1500), steps=300_000)
    study = Study(collect([tmp_path]))
    table = report.Report(study, "ppo_source", 0).main_table()
    assert [row[6] for row in table.rows] == [None, None]


@pytest.mark.usefixtures("quick")
def test_robots_and_settings_are_drawn_apart(tmp_path: Path) -> None:
    """A higher learning rate is beside the baseline, and so are the divergences of its updates."""
    for seed in range(2):
        make_run(tmp_path, "ppo_source", seed, (10, 5), algorithm={"learning_rate": 3e-4})
        make_run(tmp_path, "ppo_lr3e3", seed, (5, 1), algorithm={"learning_rate": 3e-3})
        make_run(tmp_path, "ndr", seed, (9, 8), algorithm={"learning_rate": 3e-4})
    pictures = dict(Pictures(Study(collect([tmp_path])), "ppo_source", tmp_path, 200, 0).draw())
    kinds = ("learning_curves_robots", "learning_curves_settings", "divergence_settings")
    assert list(pictures) == [f"plots/{kind}.png" for kind in kinds]
    assert all((tmp_path / picture).stat().st_size > 5000 for picture in pictures)


def test_mistakes_are_sentences(tmp_path: Path) -> None:
    """No runs given, and keys of other verbs."""
    with pytest.raises(Sim2RealError, match=r"report needs runs; give runs=FOLDER"):
        verb.run(runs=None, baseline=None, seed=0, out=tmp_path)
    with pytest.raises(ConfigError, match="frames is not used by report"):
        compose(["run=report", "frames=5"])


def test_experiments_claim_what_can_be_judged() -> None:
    """Every claim and figure in conf/ is well formed and names an experiment that there is."""
    claims = []
    for name in options("experiment"):
        tree = yaml.safe_load((CONF / "experiment" / f"{name}.yaml").read_text(encoding="utf-8"))
        expect = tree.get("expect") or {}
        claims += [Claim.of(claim) for claim in expect.get("claims", ())]
        for figure in expect.get("figures", ()):
            assert set(figure) <= {"when", "source", "target"}
            assert all(len(figure[robot]) == 2 for robot in set(figure) - {"when"})
    sides = [side for c in claims for side in (c.left, c.right) if side is not None]
    assert len(claims) > 10
    assert {side.experiment for side in sides} <= set(options("experiment"))
    assert {side.robot for side in sides} <= {"source", "target", None}


@pytest.mark.usefixtures("quick")
def test_what_has_no_bars_has_curves_and_no_old_picture_stays(tmp_path: Path) -> None:
    """Settings in words cannot stand along an axis; a picture of fewer runs would mislead."""
    runs, out = tmp_path / "runs", tmp_path / "out"
    for how in ("rays", "gl"):
        make_run(runs, "pixels", 0, (1, 2), params={"renderer": how})
    (out / "plots").mkdir(parents=True)
    for name in ("learning_curves_robots.png", "learning_curve.png"):
        (out / "plots" / name).write_bytes(b"")
    make_run(runs, "pixels", 0, (3, 4), params={"renderer": "gl"}, steps=1_000_000)
    make_run(runs, "pixels", 1, (1, 2), params={"renderer": "gl"})
    study = Study(collect([runs]))
    assert [group.reported_budgets() for group in study.groups] == [[500_000, 1_000_000], [500_000]]
    pictures = Pictures(study, None, out, draws=50, seed=0).draw()
    assert [place for place, _ in pictures] == ["plots/learning_curves.png"]
    kept = {path.name for path in (out / "plots").iterdir()}
    assert kept == {"learning_curves.png", "learning_curve.png"}  # a training's own picture stays
    rows = report.Report(study, None, 0).main_table().rows
    assert [list(row[:4]) for row in rows] == [
        ["pixels renderer=gl", "source", 2, 500_000.0],
        ["pixels renderer=gl", "source", 1, 1_000_000.0],
        ["pixels renderer=rays", "source", 1, 500_000.0],
    ]
