"""Runs are found, grouped by what was swept, and kept apart where they do not belong together."""

from pathlib import Path

import numpy as np
import pytest

from sim2real.evaluation.study import RunsError, Study, budgets, collect
from tests.sim2real.made_runs import make_run


def test_what_was_swept_is_found_by_comparing(tmp_path: Path) -> None:
    """Two widths of one experiment are two groups by size; an experiment alone has no label."""
    for seed in (0, 1):
        make_run(tmp_path, "ppo_source", seed, (10, 5))
        for width in (0.1, 0.05):
            make_run(tmp_path / "sweep", "udr", seed, (10 + seed, 5), params={"width": width})
    study = Study(collect([tmp_path]))
    assert [group.label for group in study.groups] == [
        "ppo_source",
        "udr width=0.05",
        "udr width=0.1",
    ]
    np.testing.assert_array_equal(study.returns(study.groups[1], "source"), [10, 11])
    assert study.find("udr", {"params.width": 0.1}) == [study.groups[2]]


def test_labels_are_short_and_different(tmp_path: Path) -> None:
    """A class is named by its last word, a list not at all; equal labels are numbered."""
    make_run(tmp_path, "udr", 0, (1, 1), params={"_target_": "envs.factors.normal", "std": 0.1})
    for draws in ([1], [2]):
        params = {"_target_": "envs.randomization.Randomization", "draws": draws}
        make_run(tmp_path, "udr", 0, (1, 1), params=params)
    labels = {group.label for group in Study(collect([tmp_path])).groups}
    assert labels == {
        "udr params=normal std=0.1",
        "udr params=Randomization",
        "udr params=Randomization (2)",
    }


def test_seeds_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """Seed 10 comes after seed 9."""
    for seed in (9, 10, 2):
        make_run(tmp_path, "udr", seed, (seed, 0))
    study = Study(collect([tmp_path]))
    np.testing.assert_array_equal(study.returns(study.groups[0], "source"), [2, 9, 10])


def test_a_run_counts_once_for_each_budget(tmp_path: Path) -> None:
    """Evaluated after 300k, after 500k, and once more after 500k: the newest of these counts."""
    make_run(tmp_path, "udr", 0, (1, 1), steps=301_056)
    folder = make_run(tmp_path, "udr", 0, (2, 2), steps=501_760)
    make_run(tmp_path / "again", "udr", 0, (3, 3), steps=500_736)
    (group,) = (study := Study(collect([tmp_path]))).groups
    assert list(group.runs) == [301_056, 500_736]
    assert study.returns(group, "target").tolist() == [3]
    assert study.returns(group, "target", 301_056).tolist() == [1]
    assert folder.exists()


def test_budgets_within_a_tenth_are_one() -> None:
    """Rollouts of other lengths end a little apart; steps that creep on do not become one."""
    found = budgets([501_760, 500_736, 300_000])
    assert found == {300_000: 300_000, 500_736: 500_736, 501_760: 500_736}
    assert budgets([100, 109, 118]) == {100: 100, 109: 100, 118: 118}


def test_metrics_end_where_the_evaluation_was(tmp_path: Path) -> None:
    """What came after the evaluated policy does not count."""
    curve = [(1000, 10.0), (2000, 30.0), (3000, 20.0), (9000, 99.0)]
    make_run(tmp_path, "udr", 0, (1, 1), steps=3000, curve=curve)
    (group,) = (study := Study(collect([tmp_path]))).groups
    assert study.metric(group, "train/return", "max", 3000).tolist() == [30]
    assert study.metric(group, "train/return", "last", 3000).tolist() == [20]
    with pytest.raises(RunsError, match=r"metrics\.csv has no train/kl"):
        study.metric(group, "train/kl", "max", 3000)


def test_mistakes_are_sentences(tmp_path: Path) -> None:
    """No folder, a folder without runs, a run without its configuration, mixed tasks or robots."""
    with pytest.raises(RunsError, match=r"runs=.*nowhere does not exist"):
        collect([tmp_path / "nowhere"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunsError, match=r"runs=.*empty holds no evaluated run; .*eval=transfer"):
        collect([tmp_path / "empty"])
    make_run(tmp_path / "a", "ppo_source", 0, (1, 1))
    make_run(tmp_path / "b", "walker", 0, (1, 1), task="Walker2d")
    make_run(tmp_path / "c", "ppo_source", 1, (1, 1), masses="legacy")
    with pytest.raises(RunsError, match=r"evaluated on .*HopperPolito.*Walker2d|Walker2d.*report"):
        Study(collect([tmp_path / "a", tmp_path / "b"]))
    with pytest.raises(RunsError, match=r"legacy.*; report them separately"):
        Study(collect([tmp_path / "a", tmp_path / "c"]))
    (make_run(tmp_path / "d", "udr", 0, (1, 1)) / "config.yaml").unlink()
    with pytest.raises(RunsError, match=r"no readable config\.yaml"):
        collect([tmp_path / "d"])
