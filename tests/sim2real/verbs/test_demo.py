"""The log of the diagnosis's demo is what its recipe makes."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from hardware.assets import ASSETS
from hardware.log import read_logs
from tests.sim2real.trained import run_verb

DEMO = ASSETS / "demo" / "arm2.csv"


@pytest.mark.slow
def test_the_shipped_log_is_made_by_its_experiment(tmp_path: Path) -> None:
    """Recording the emulated arm with what it hides gives the same rows, to rounding."""
    again = run_verb(["+experiment=record_demo"], tmp_path)
    (shipped,) = read_logs(str(DEMO))
    assert list(again.columns) == list(shipped.columns)
    for name, values in shipped.columns.items():
        np.testing.assert_allclose(again.columns[name], values, atol=1e-6, err_msg=name)


def test_the_shipped_log_names_its_robot_and_not_what_it_hides() -> None:
    """The model lies beside it; the answer is in another file."""
    (log,) = read_logs(str(DEMO))
    assert log.model is not None and log.model.samefile(ASSETS / "arm2.xml")
    assert not {"hidden", "effects"} & set(log.meta)
    assert DEMO.stat().st_size < 5e5


@pytest.mark.slow
def test_the_demo_names_what_the_arm_hides(tmp_path: Path) -> None:
    """Both effects at their places, values near, hardly a gap left; the page says so."""
    report = run_verb(["+experiment=diagnose_demo"], tmp_path)
    hidden = yaml.safe_load(DEMO.with_name("answer.yaml").read_text(encoding="utf-8"))
    found = {(cause.effect, cause.where): cause for cause in report.causes}
    assert report.verdict == "explained"
    assert found.keys() == {(entry["effect"], entry["where"]) for entry in hidden}
    for entry in hidden:
        value = found[entry["effect"], entry["where"]].value
        assert value == pytest.approx(entry["value"], rel=0.15)
    assert report.gap.closed is not None and report.gap.closed > 0.97
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Command delay and Coulomb friction at elbow explain" in page
