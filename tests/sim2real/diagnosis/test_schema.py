"""The report as JSON and back."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis import schema
from sim2real.runs.errors import Sim2RealError

REPORT = schema.Report(
    "explained",
    schema.GapMetrics("rad", 0.021, 0.003, 0.002, 0.95, (0.93, 0.97), True),
    (schema.JointGap("elbow", 0.9, 0.02, 0.003, (schema.Regime("reversal", 0.7),)),),
    (
        schema.Cause(
            "backlash",
            "elbow",
            "motor",
            0.049,
            (0.045, 0.053),
            "rad",
            {},
            0.97,
            0.93,
            "holds",
            (schema.Equivalent("joint_compliance", "elbow"),),
        ),
    ),
    schema.Unexplained(0.05, "none"),
    (schema.Finding("sign", "wrist", "it turns the other way", "flip its sign"),),
    {"timestep": "ok"},
    "a slow ramp with reversals",
    31.0,
    schema.WholeReplay(0.031, 0.004),
    failed=("the pictures of recordings: no disk",),
)
KEYS = {
    "schema": None,
    "verdict": None,
    "gap": {"unit", "before", "after", "noise_floor", "closed", "closed_ci", "held_out"},
    "where": {"joint", "share", "before", "after", "regimes"},
    "causes": {
        *("effect", "where", "side", "value", "value_ci", "unit", "extra", "confidence"),
        *("closed", "form", "equivalent", "shared", "encoder"),
        *("kind", "seconds", "remedy"),
    },
    "unexplained": {"share", "structure"},
    "preflight": {"check", "where", "finding", "fix"},
    "numerics": {"timestep"},
    "next_experiment": None,
    "replay": {"before", "after"},
    "closed_loop": None,
    "failed": None,
    "fitted": None,
    "deviations": None,
    "calibrated": None,
    "seconds": None,
}


def test_a_report_survives_its_file(tmp_path: Path) -> None:
    """What is written and read again is the same report."""
    path = REPORT.write(tmp_path / "report.json")
    assert schema.Report.from_json(json.loads(path.read_text(encoding="utf-8"))) == REPORT


def test_a_report_of_an_older_version_is_read() -> None:
    """One of schema 1, or without the figures of run=replay, has none of what came later."""
    later = ("replay", "fitted", "deviations", "calibrated")
    older = {name: part for name, part in REPORT.to_json().items() if name not in later}
    for cause in older["causes"]:
        del cause["kind"], cause["seconds"], cause["remedy"]
        del cause["shared"], cause["encoder"], cause["equivalent"][0]["inseparable"]
        del cause["equivalent"][0]["kind"]
    assert schema.Report.from_json({**older, "schema": 1}) == replace(REPORT, replay=None)


def test_a_report_of_schema_2_is_read() -> None:
    """Its causes say nothing of their kind: they are the robot's, and act throughout."""
    older = REPORT.to_json()
    for cause in older["causes"]:
        del cause["kind"], cause["seconds"], cause["remedy"], cause["equivalent"][0]["kind"]
    read = schema.Report.from_json({**older, "schema": 2})
    assert read == REPORT
    assert read.effects == read.values == read.causes


def test_only_the_robots_causes_are_effects() -> None:
    """A mistake of the log has a value and a remedy, and never stands in effects.yaml."""
    late = replace(REPORT.causes[0], effect="row_shift", where=None, kind="log", remedy="move it")
    both = replace(REPORT, causes=(late, *REPORT.causes))
    assert both.values == (late, *REPORT.causes)
    assert both.effects == REPORT.causes
    assert schema.Report.from_json(both.to_json()) == both


def test_fitted_values_survive_the_file_and_are_no_causes() -> None:
    """Values that are only fitted stand apart, in the order of effects.yaml."""
    many = tuple(replace(REPORT.causes[0], where=f"joint{n}") for n in range(5))
    fitted = replace(REPORT, verdict="fitted", causes=(), fitted=many)
    tree = json.loads(json.dumps(fitted.to_json()))
    assert (tree["verdict"], tree["causes"], len(tree["fitted"])) == ("fitted", [], 5)
    assert schema.Report.from_json(tree) == fitted
    assert fitted.values == many
    assert REPORT.values == REPORT.causes


def test_the_file_has_the_keys_of_schema_3() -> None:
    """Every key that readers rely on is there, and no other."""
    tree = REPORT.to_json()
    assert tree["schema"] == 3
    assert set(tree) == set(KEYS)
    for name, keys in KEYS.items():
        part = tree[name][0] if isinstance(tree[name], list) and tree[name] else tree[name]
        assert keys is None or set(part) == keys
    same = tree["causes"][0]["equivalent"][0]
    assert set(same) == {"effect", "where", "inseparable", "kind"}


def test_numbers_are_plain() -> None:
    """NumPy's numbers become JSON's, and what is not finite becomes null."""
    gap = schema.GapMetrics("rad", float(np.float64(0.02)), None, 0.001, np.nan, None, True)
    report = schema.Report("no_gap", gap, (), (), schema.Unexplained(0.0, "none"))
    tree = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert tree["gap"]["closed"] is None
    assert tree["gap"]["before"] == 0.02


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 4}, "schema 1, 2 or 3"),
        ({"verdicts": "explained"}, "no key 'verdicts'"),
        ({"unexplained": {"share": 0.1}}, "incomplete"),
    ],
)
def test_another_table_is_refused(change: dict, words: str) -> None:
    """Another schema, an unknown key and a missing one are named."""
    with pytest.raises(Sim2RealError, match=words):
        schema.Report.from_json({**REPORT.to_json(), **change})
