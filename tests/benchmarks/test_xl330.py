"""The real servo's figures: the gain that its PWM tells, errors with what was found, tables."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import xl330
from benchmarks.xl330 import COUNTS, FULL, GAINS, gain_of, report, share_of_gain
from envs.effects import make, write_effects
from hardware.log import Log


def made_log(gain: int, divisor: float, name: str = "p") -> Log:
    """Return a log whose servo has a divisor, saturates, and is switched off at its end."""
    time = np.arange(200) / 100
    position = 0.3 * np.sin(4 * time)
    ahead = 0.8 * np.sin(9 * time)
    on = (time < 1.5).astype(float)
    pwm = np.clip(np.rint(gain * COUNTS / (2 * np.pi) * ahead / divisor), -FULL, FULL) * on
    columns = {"episode": np.zeros(200), "time": time, "ctrl.hinge": position + ahead}
    columns |= {"qpos.hinge": position, "torque.hinge": on, "sensor.pwm": pwm}
    meta = {"settings": {"hinge": {"position_p_gain": gain}}}
    return Log(columns, meta, Path(f"{name}{gain}.csv"))


def test_the_pwm_tells_the_divisor() -> None:
    """Half the gain where the divisor is 256 and not 128, whatever saturates or is off."""
    for gain in (100, 800):
        log = made_log(gain, 256.0)
        assert gain_of(log) == gain
        assert share_of_gain(log) == pytest.approx(0.5, rel=0.01)
    assert share_of_gain(made_log(200, 128.0)) == pytest.approx(1.0, rel=0.01)


def test_the_report_has_causes_and_gains_that_were_left_out(tmp_path: Path, monkeypatch) -> None:
    """A gain's logs are replayed under what was found from the others."""
    asked: list[str] = []

    def error(log: Log, effects: Path | None = None) -> float:
        asked.append(f"{gain_of(log)} {effects.parent.name if effects else 'nominal'}")
        return 0.3 if effects is None else 0.05

    monkeypatch.setattr(xl330, "error", error)
    cause = {"effect": "position_gain", "where": "hinge", "value": 0.5, "unit": "", "closed": 0.7}
    cause |= {"value_ci": [0.45, 0.55], "equivalent": []}
    answer = {"verdict": "partly_explained", "gap": {"before": 0.3, "after": None}}
    answer |= {"causes": [cause], "unexplained": {"structure": "slow"}}
    for name in ("all", *(f"without_{gain}" for gain in GAINS)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.json").write_text(json.dumps(answer))
        found = [(make("position_gain", where="hinge"), (0.5,))]
        write_effects(tmp_path / name / "effects.yaml", found)
    logs = [made_log(gain, 256.0, name) for gain in GAINS for name in "ab"]
    table = report(logs, tmp_path, tmp_path / "results")
    assert [row[0] for row in table.rows] == ["P gain 100", "P gain 200", "P gain 800"]
    assert [row[2].value for row in table.rows] == pytest.approx([50.0] * 3)  # type: ignore[union-attr]
    assert {"100 without_100", "200 without_200", "800 without_800"} <= set(asked)
    page = (tmp_path / "results" / "xl330.md").read_text()
    assert "says 0.500 of the manual's gain" in page and "| position_gain | hinge |" in page
