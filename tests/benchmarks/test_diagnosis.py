"""The diagnosis' rows: both fits find what the emulated arm hides, and the table tells the time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mujoco import sysid

from benchmarks import diagnosis
from benchmarks.ground import KNEE
from benchmarks.report import document, table
from benchmarks.rows import diagnosis as rows
from benchmarks.rows.base import Row, Timing
from benchmarks.rows.walks import CAUSES, DiagnoseWalks, PriceCauses
from benchmarks.speed import Measured, default_rows

SYSID = hasattr(sysid, "optimize")  # without its extra the package is empty


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> rows.Recorded:
    """Half a minute would be better; nine seconds are enough for six values."""
    return rows.record(tmp_path_factory.mktemp("arm"), 3, 9.0, 1)


def check(worked: rows.Worked) -> None:
    """Require the hidden friction and gain, nothing elsewhere, and counted replays."""
    friction, gain = np.reshape(worked.values, (2, 3))
    np.testing.assert_allclose(friction, [0, 0, rows.HIDDEN[0]["value"]], atol=0.03)
    np.testing.assert_allclose(gain, [1, rows.HIDDEN[1]["value"], 1], atol=0.12)
    assert worked.amount > 10
    assert worked.seconds > 0
    assert worked.memory > 5e7


@pytest.mark.slow
def test_the_fit_finds_what_is_hidden(recorded: rows.Recorded) -> None:
    """Of six values four are neutral and two are those of the emulated arm."""
    check(rows.fitted(recorded))


@pytest.mark.skipif(not SYSID, reason="needs mujoco[sysid]; pip install '.[bench]'")
def test_sysid_is_given_the_same_fit(recorded: rows.Recorded) -> None:
    """mujoco.sysid finds the same values: what it is compared with is no worse a question."""
    check(rows.fitted_by_sysid(recorded))


def test_the_table_tells_the_time_and_its_limit() -> None:
    """A row with a limit has a line of its own, of the median time of its runs."""
    row = rows.Diagnose("diagnose_3_joints", 3, 48.0, 1)
    one = Measured(row, [Timing(48, s, 0) for s in (50.0, 70.0, 400.0)], [0.0] * 3, 3e8)
    machine = {"cpu": "c", "cores": 2, "torch_threads": 1, "omp_num_threads": "1"}
    text = table(document([one], [], machine))
    assert "| diagnose_3_joints | 70.0 | 40 | 15 | **no** |" in text
    assert "0.69 s of log" in text
    assert "GiB" not in text


@pytest.mark.parametrize(("memory", "holds"), [(1.5, "yes"), (3.0, "**no**")])
def test_the_table_tells_the_memory_and_its_limit(memory: float, holds: str) -> None:
    """The six joints may take two GiB at most."""
    row = rows.Diagnose("diagnose_6_joints", 6, 120.0, 3)
    one = Measured(row, [Timing(360, 30.0, 0)], [0.0], memory * 2**30)
    machine = {"cpu": "c", "cores": 2, "torch_threads": 1, "omp_num_threads": "1"}
    text = table(document([one], [], machine))
    assert "| diagnose_6_joints | 30.0 | 100 | 45 | yes, and the goal |" in text
    assert f"| diagnose_6_joints | {memory:.2f} | 2 | {holds} |" in text


@pytest.mark.slow
def test_a_row_prices_causes() -> None:
    """Every subset of the causes has its episodes, and each cause a price."""
    row = PriceCauses("worth_quad8", 2)
    row.build()
    assert row.run().steps == 2 * 2 ** len(CAUSES)
    assert row.worth
    assert len(row.worth.last["return"]) == len(CAUSES)
    one = Measured(row, [Timing(1024, 60.0, 1024)], [0.0], None)
    machine = {"cpu": "c", "cores": 2, "torch_threads": 1, "omp_num_threads": "1"}
    assert "| worth_quad8 | 60.0 | 120 |  | yes |" in table(document([one], [], machine))


def timed(row: Row) -> Timing:
    """Return what a row takes."""
    row.build()
    try:
        return row.run()
    finally:
        row.close()


@pytest.mark.slow
def test_a_row_diagnoses_walks() -> None:
    """The knee's friction is found in walks whose base nobody logged."""
    row = DiagnoseWalks("diagnose_quad8_walks", 4)
    timing = timed(row)
    assert timing.steps == pytest.approx(4 * 3.0 - 2 * 1.0, abs=0.2)
    assert row.found
    assert row.found.values[0] == pytest.approx(KNEE["value"], abs=0.03)


@pytest.mark.slow
def test_a_row_diagnoses_in_its_own_process() -> None:
    """The row records, diagnoses, and tells the memory of its process."""
    row = rows.Diagnose("diagnose_3_joints", 3, 9.0, 1)
    timing = timed(row)
    assert timing.steps == pytest.approx(9.0, abs=0.1)
    assert row.peak() > 5e7  # type: ignore[operator]
    assert row.found
    assert row.found.values


def test_what_the_rows_come_to_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program names rows that exist and copies what they come to, but not after a failure."""

    def run(arguments: Sequence[str]) -> int:
        names = arguments[arguments.index("--rows") + 1].split(",")
        assert set(names) <= {row.name for row in default_rows()}
        out = Path(arguments[arguments.index("--out") + 1])
        out.mkdir(exist_ok=True)
        for name in diagnosis.KEPT:
            (out / name).write_text(name, encoding="utf-8")
        return status

    monkeypatch.setattr(diagnosis.speed, "main", run)
    places = ["--out", str(tmp_path / "out"), "--results", str(tmp_path / "kept")]
    status = 1
    assert diagnosis.main(places) == 1
    assert not (tmp_path / "kept").exists()
    status = 0
    assert diagnosis.main(places) == 0
    kept = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "kept").iterdir()}
    assert kept == {kept: name for name, kept in diagnosis.KEPT.items()}
