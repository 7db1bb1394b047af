"""The page of the seeds' tables: it is made of the committed results, and more of them fill it."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.cases import read_csv
from benchmarks.seeds import train
from benchmarks.seeds.__main__ import PAGE, main
from benchmarks.seeds.claims import decide
from benchmarks.seeds.figures import Found, find
from benchmarks.seeds.page import load, page, rows
from benchmarks.study import RESULTS
from envs.params import Parameter
from sim2real import compose
from sim2real.evaluation.grid import Axis, Grid
from sim2real.evaluation.scores import GridScores
from sim2real.runs.errors import Sim2RealError

TOY = {"do": ["+experiment=nav2d"]}
TABLES = {"t": {"file": "t.csv", "run": "seed", "value": "after", "steps": "steps"}}
TABLE = """seed,kind,x,before,after,steps
0,a,1,1,10,100
0,a,3,2,30,100
1,a,1,3,50,300
1,b,1,4,70,
"""
GROWING = ("seeds", "easi")  # tables of studies that are run row by row


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of results with one small table."""
    (tmp_path / "t.csv").write_text(TABLE, encoding="utf-8")
    return tmp_path


def test_the_page_is_that_of_the_committed_results() -> None:
    """docs/seeds.md is what the command writes now; after new results it must be made again."""
    assert PAGE.read_text(encoding="utf-8") == page(load(), RESULTS)


def test_every_query_of_a_finished_study_finds_runs() -> None:
    """No row is empty because its query is wrong: outside the tables that grow, all find runs."""
    content = load()
    for row in content["rows"]:
        for name, measure in row["measures"].items():
            query = measure.get("ours")
            if query and query["table"] not in GROWING:
                assert find(query, content["tables"], RESULTS).values, (row["id"], name)


@pytest.mark.slow
@pytest.mark.parametrize("name", load()["trainings"])
def test_a_training_composes(name: str) -> None:
    """A training is a command line that runs, and so is the evaluation after it."""
    trainings = load()["trainings"]
    about = trainings[name]
    compose(trainings[about.get("of", name)]["do"])
    if "then" in about:
        compose([*trainings[about.get("of", name)]["do"], *about["then"]])


def test_every_training_belongs_to_a_row() -> None:
    """What a training measures has a place, and each row pays for what it shows."""
    content = load()
    wanted = {
        measure["ours"]["where"]["training"]
        for row in content["rows"]
        for measure in row["measures"].values()
        if measure.get("ours", {}).get("table") == "seeds"
    }
    assert wanted <= set(content["trainings"])
    paid = {name for row in content["rows"] for name in row.get("trainings", ())}
    assert wanted == paid


def test_a_figure_is_the_mean_of_a_runs_rows(folder: Path) -> None:
    """Cells of one run count as one; ranges and what lies outside choose among them."""
    every = find({"table": "t", "where": {"kind": "a"}}, TABLES, folder)
    assert every.values == {"0": 20.0, "1": 50.0}
    assert every.steps == 100.0 and every.minutes is None
    assert find({"table": "t", "where": {"x": [2, 4]}}, TABLES, folder).values == {"0": 30.0}
    outside = find({"table": "t", "outside": {"x": [2, 4]}}, TABLES, folder)
    assert outside.values == {"0": 10.0, "1": 60.0}
    assert find({"table": "t", "where": {"x": 3}, "value": "before"}, TABLES, folder).values == {
        "0": 2.0
    }


def test_a_query_for_what_is_not_there_is_refused(folder: Path) -> None:
    """A column or a table that is misspelt is an error; a table that is not yet there is not."""
    with pytest.raises(Sim2RealError, match=r"no column 'kin'; it has seed"):
        find({"table": "t", "where": {"kin": "a"}}, TABLES, folder)
    with pytest.raises(Sim2RealError, match="'u'"):
        find({"table": "u"}, TABLES, folder)
    assert find({"table": "t"}, TABLES, folder / "none").values == {}


def found(*values: float) -> Found:
    """Return figures of runs 0, 1, ..."""
    return Found({str(run): value for run, value in enumerate(values)})


@pytest.mark.parametrize(
    ("claim", "answer"),
    [
        ({"is": "above"}, "holds"),
        ({"is": "below"}, "contradicted"),
        ({"is": "above", "by": 10.0}, "undecided"),
        ({"is": "above", "by": 20.0}, "contradicted"),
        ({"is": "above", "times": 2.0}, "contradicted"),
        ({"is": "above", "right": 100.0}, "holds"),
        ({"is": "above", "right": "r.none"}, "not run"),
    ],
)
def test_a_claim_is_decided_by_the_interval_of_the_difference(claim: dict, answer: str) -> None:
    """Left is above right by 10 on the mean, give or take 2."""
    measures = {
        "r.left": found(108.0, 109.0, 110.0, 111.0, 112.0),
        "r.right": found(98.0, 99.0, 100.0, 101.0, 102.0),
        "r.none": found(),
    }
    told = {"claim": "c", "left": "left", "right": "right", **claim}
    assert decide(told, "r", measures, "mean").answer == answer


def test_pairs_and_few_runs() -> None:
    """A gain that every seed has holds although seeds differ by more; three runs are marked."""
    before = found(1.0, 50.0, 100.0)
    after = found(2.0, 51.5, 101.0)
    claim = {"claim": "c", "left": "after", "is": "above", "right": "before"}
    measures = {"r.before": before, "r.after": after}
    assert decide(claim, "r", measures, "mean").answer == "undecided"
    verdict = decide({**claim, "paired": True}, "r", measures, "mean")
    assert verdict.answer == "holds" and str(verdict).startswith("holds, few runs: c (1.")


def test_new_results_fill_a_row(tmp_path: Path) -> None:
    """Figures in seeds.csv turn "not run" into a figure, its cost and a verdict."""
    content = load()
    empty = {row.about["id"]: row for row in rows(content, tmp_path)}
    assert not any(row.run for row in empty.values())
    lines = [",".join(train.COLUMNS)]
    for seed in range(3):
        for figure, value in (("source", 1500 + seed), ("target", 900 - seed)):
            lines.append(f"trpo_source,{seed},{figure},{value},500000,3.0,c,v")
    (tmp_path / "seeds.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    filled = {row.about["id"]: row for row in rows(content, tmp_path)}
    trpo = filled["trpo"]
    assert trpo.run and [v.answer for v in trpo.verdicts] == ["holds", "not run"]
    runs, minutes = (content["trainings"]["trpo_target"][k] for k in ("runs", "minutes"))
    own = content["trainings"]["trpo_source"]["runs"]
    assert trpo.hours == pytest.approx((own * 3.0 + runs * minutes) / 60)
    assert sum(row.run for row in filled.values()) == 1


def trainings(
    monkeypatch: pytest.MonkeyPatch, level: Callable[[int], float | None]
) -> list[tuple[str, ...]]:
    """Let jobs leave scores by their number, None for one that fails; return their words."""
    jobs: list[tuple[str, ...]] = []

    def job(*words: str) -> bool:
        jobs.append(words)
        folder = Path(next(w for w in words if w.startswith("hydra.run.dir=")).split("=", 1)[1])
        more = level(len(jobs))
        if more is not None:
            leave_scores(folder, more)
        return more is not None

    monkeypatch.setattr(train, "sim2real", job)
    return jobs


def test_a_training_is_done_once_and_its_figures_stay(tmp_path: Path, monkeypatch) -> None:
    """A complete run is skipped; the rows of runs that are elsewhere stay in the table."""
    jobs = trainings(monkeypatch, lambda number: 0.0)
    plan = train.Plan({"toy": TOY}, tmp_path / "out", tmp_path / "seeds.csv")
    plan.table.write_text(",".join(train.COLUMNS) + "\nold,7,after,1.5,10,0.1,c,v\n", "utf-8")
    assert train.run("toy", [0, 1], plan) == 0
    assert train.run("toy", [0, 1], plan) == 0
    assert [word for words in jobs for word in words if word.startswith("seed=")] == [
        "seed=0",
        "seed=1",
    ]
    table = read_csv(plan.table)
    assert [(row["training"], row["seed"], row["figure"]) for row in table] == [
        ("old", "7", "after"),
        *(("toy", seed, figure) for seed in "01" for figure in ("after", "before")),
    ]
    assert float(table[1]["value"]) == 3.5 and table[1]["steps"] == "1000"
    assert "mujoco" in table[1]["versions"] and "+experiment=nav2d" in table[1]["command"]


def test_an_evaluation_after_training_gives_the_figures(tmp_path: Path, monkeypatch) -> None:
    """It follows the training, is what counts, and is all that is done again where it failed."""
    levels = {2: None, 3: 10.0}
    jobs = trainings(monkeypatch, lambda number: levels.get(number, 0.0))
    out, table = tmp_path / "out", tmp_path / "seeds.csv"
    plan = train.Plan({"toy": TOY | {"then": ["adapt=batch"]}}, out, table)
    assert train.run("toy", [0], plan) == 1 and read_csv(table) == []
    assert train.run("toy", [0], plan) == 0
    assert [words[0] for words in jobs] == ["+experiment=nav2d", *("run=evaluate",) * 2]
    assert jobs[-1][1] == f"checkpoint={out / 'toy' / 'seed0'}" and "adapt=batch" in jobs[-1]
    assert [float(row["value"]) for row in read_csv(table)] == [13.5, 11.5]


def leave_scores(folder: Path, more: float = 0.0) -> None:
    """Write what an evaluated training leaves behind."""
    grid = Grid([Axis("goal", low=-1.0, high=1.0, count=2)], {})
    before, after = np.array([[[1.0], [2.0]]]) + more, np.array([[[3.0], [4.0]]]) + more
    goal, none = (Parameter("goal", "goal"),), before * 0
    scores = GridScores(
        *(grid, goal, {}, ("seed 0",), (1000,), (10,), 1, 3, before, after, none, none)
    )
    scores.write(folder, seed=0, threshold=0.0, summary=[])
    manifest = {"packages": {"mujoco": "4.0.0"}, "git": None}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


def test_a_policy_is_trained_once_for_several_evaluations(tmp_path: Path, monkeypatch) -> None:
    """Each has figures of its own, and the policy's own stay where they are."""
    jobs = trainings(monkeypatch, lambda number: float(number))
    other = {"of": "toy", "then": ["adapt=noisy"]}
    trained = {"toy": TOY, "one": other, "other": other}
    plan = train.Plan(trained, tmp_path / "out", tmp_path / "seeds.csv")
    assert train.run("one", [0], plan) + train.run("other", [0], plan) == 0
    assert [words[0] for words in jobs] == ["+experiment=nav2d", *("run=evaluate",) * 2]
    assert all(f"checkpoint={tmp_path / 'out' / 'toy' / 'seed0'}" in words for words in jobs[1:])
    after = {r["training"]: r["value"] for r in read_csv(plan.table) if r["figure"] == "after"}
    assert after == {"toy": "4.5", "one": "5.5", "other": "6.5"}


def test_a_training_that_is_not_there_is_refused(capsys: pytest.CaptureFixture) -> None:
    """A misspelt name is answered with those that there are."""
    with pytest.raises(SystemExit):
        main(["--run", "nav3d"])
    assert "no training 'nav3d'; there are: all, nav2d," in capsys.readouterr().err


def test_the_list_says_what_all_would_take(capsys: pytest.CaptureFixture) -> None:
    """One line a training, the cheapest first, and the hours of all."""
    assert main(["--list"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert len(lines) == len(load()["trainings"])
    minutes = [float(line.split(" x ")[1].split(" ")[0]) for line in lines]
    assert minutes == sorted(minutes) and last.startswith("all: ")


@pytest.mark.parametrize(
    ("left", "needed"),
    [
        ((3.0,), "needs 5 runs"),  # without a spread: as many as an interval needs
        ((-1.0, 3.0), "needs 8 runs"),  # 1 [-1, 3] of two: a quarter of the width takes 4 times 2
        ((-1.0, 1.02), "needs over 100 runs"),
        ((1.0, 3.0), None),
    ],
)
def test_an_undecided_claim_says_how_many_runs_it_needs(
    left: tuple[float, ...], needed: str | None
) -> None:
    """An interval shrinks with the root of the number of runs; a decided claim needs no more."""
    claim = {"claim": "c", "left": "left", "is": "above", "right": 0.0}
    verdict = str(decide(claim, "r", {"r.left": found(*left)}, "mean"))
    assert verdict.endswith(needed) if needed else "needs" not in verdict
