"""Scores of a grid are summed up by the right unit, survive their files, and combine only alike."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs.params import Parameter
from sim2real.evaluation.grid import Grid
from sim2real.evaluation.scores import GridScores, ScoresError, merge_runs
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

GRID = Grid(
    [
        {"parameter": "link_mass.torso", "low": 1.0, "high": 4.0, "count": 4},
        {"parameter": "ground_friction", "values": [1.0, 2.0, 3.0]},
    ]
)
PARAMETERS = (
    Parameter("link_mass.torso", "link_mass", "torso", unit="kg", how="set"),
    Parameter("ground_friction", "ground_friction", how="set"),
)
BOX = {"link_mass.torso": (1.5, 3.5), "ground_friction": (2.0, 2.0)}


def scores(runs: int = 3, adaptations: int = 5, seed: int = 0, spend: int = 3) -> GridScores:
    """Return scores of runs 100 apart, in which adaptation gains 50."""
    rng = np.random.default_rng(seed)
    before = 1000 + 100 * rng.normal(size=(runs, 1, 1)) + rng.normal(size=(runs, 12, adaptations))
    after = before + 50 + rng.normal(size=before.shape)
    sd = np.ones_like(before)
    names = tuple(f"seed {seed + i}" for i in range(runs))
    counts = ((1000,) * runs, (500,) * runs)
    return GridScores(GRID, PARAMETERS, BOX, names, *counts, 10, spend, before, after, sd, 2 * sd)


def summary(of: GridScores) -> Table:
    """Sum scores up with few resamples."""
    return of.summary(threshold=1000, draws=500, rng=np.random.default_rng(0))


def row(table: Table, cells: str, policy: str) -> dict:
    """Return the only row of these cells and policy, by column."""
    found = [r for r in table.rows if cells in str(r[0]) and policy in str(r[1])]
    assert len(found) == 1
    return dict(zip(table.columns, found[0], strict=True))


def test_regions_split_the_grid() -> None:
    """Two of twelve cells lie in the training range, ten outside."""
    regions = {name: int(mask.sum()) for name, mask in scores().regions().items()}
    assert regions == {
        "whole grid": 12,
        "inside the training range": 2,
        "outside the training range": 10,
    }


def test_a_point_of_training_is_inside_only_where_a_cell_is() -> None:
    """Training on one robot between the cells leaves all cells outside, and no empty region."""
    regions = replace(scores(), box={"link_mass.torso": (2.3, 2.3)}).regions()
    assert set(regions) == {"whole grid", "outside the training range"}


def test_several_runs_are_the_unit_of_the_interval() -> None:
    """Runs 100 apart leave the level uncertain by tens; the gain, equal in all, is sure."""
    table = summary(scores())
    before = row(table, "whole grid", "before")["mean return"]
    gain = row(table, "whole grid", "gain")
    assert before.high - before.low > 20
    assert gain["mean return"].high - gain["mean return"].low < 2
    assert gain["mean return"].excludes(0)
    assert gain["P(improvement)"] == Interval(1.0, 1.0, 1.0)
    assert "bootstrap over 3 training runs" in table.notes[0]
    assert "too narrow" in table.notes[0]


def test_five_runs_carry_no_warning() -> None:
    """The warning about few runs ends at five."""
    assert "too narrow" not in scores(runs=5).note()


def test_one_run_speaks_of_its_adaptations_only() -> None:
    """Its interval is over adaptations within cells, and the note says what it does not cover."""
    table = summary(scores(runs=1))
    before = row(table, "whole grid", "before")["mean return"]
    assert before.high - before.low < 1
    assert "say nothing about another training seed" in table.notes[0]


def test_estimates_lie_in_their_intervals() -> None:
    """Also where a few repeats of a few cells are far out, and cells cross the threshold."""
    noisy = scores(runs=1, adaptations=2)
    noise = np.random.default_rng(1).standard_cauchy(noisy.after.shape)
    noisy = replace(noisy, after=noisy.after + 100 * noise)
    after = row(summary(noisy), "whole grid", "after")
    for name in ("mean return", "IQM", "share of cells > 1000"):
        assert after[name].low <= after[name].value <= after[name].high


def test_one_adaptation_of_one_run_has_values_without_intervals() -> None:
    """Nothing can be resampled, so there are plain numbers and a note."""
    table = summary(scores(runs=1, adaptations=1))
    assert isinstance(row(table, "whole grid", "before")["mean return"], float)
    assert "no intervals" in table.notes[0]


def test_without_adaptation_there_is_nothing_to_gain() -> None:
    """The table has one row for each region."""
    assert [r[1] for r in summary(scores(spend=0)).rows] == ["without adaptation"] * 3


def test_training_steps_are_in_the_table() -> None:
    """The compute column says what the policy cost."""
    assert row(summary(scores()), "whole grid", "after 3 episodes")["training steps"] == 1000


def test_files_hold_everything(tmp_path: Path) -> None:
    """What is read equals what was written, to ten digits."""
    written = scores()
    written.write(tmp_path, seed=3)
    read = GridScores.read(tmp_path)
    np.testing.assert_allclose(read.after, written.after, rtol=1e-9)
    np.testing.assert_allclose(read.before_sd, written.before_sd, rtol=1e-9)
    assert (read.runs, read.frames, read.steps) == (written.runs, written.frames, written.steps)
    assert (read.grid.axes, read.box) == (written.grid.axes, written.box)
    assert (read.episodes, read.adaptation_episodes) == (10, 3)


def test_a_torn_file_is_refused(tmp_path: Path) -> None:
    """Rows that are missing, or no files at all, are one sentence with the folder."""
    scores().write(tmp_path)
    lines = (tmp_path / "grid.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "grid.csv").write_text("\n".join(lines[:-1]), encoding="utf-8")
    with pytest.raises(ScoresError, match="evaluate again"):
        GridScores.read(tmp_path)
    with pytest.raises(ScoresError, match="incomplete evaluation"):
        GridScores.read(tmp_path / "missing")


def test_runs_combine_in_order() -> None:
    """Two parts with one run each are two runs with their own returns."""
    first, second = scores(runs=1, seed=0), scores(runs=1, seed=1)
    both = merge_runs([first, second])
    assert both.runs == ("seed 0", "seed 1")
    np.testing.assert_array_equal(both.after[1], second.after[0])
    assert both.frames == (1000, 1000)


def test_runs_that_were_evaluated_otherwise_do_not_combine() -> None:
    """The first difference in the protocol is named with both values."""
    with pytest.raises(ScoresError, match="adaptation episodes 2, seed 0 has 3"):
        merge_runs([scores(runs=1), scores(runs=1, seed=1, spend=2)])
    with pytest.raises(ScoresError, match="adaptations 4, seed 0 has 5"):
        merge_runs([scores(runs=1), scores(runs=1, seed=1, adaptations=4)])
    with pytest.raises(ScoresError, match="no scores"):
        merge_runs([])
