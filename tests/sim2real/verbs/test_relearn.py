"""The loop on an emulated robot, with a diagnosis that is given: what is done, in which order."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from envs.effects import load_effects, make, write_effects
from sim2real.config.compose import compose, prepare
from sim2real.diagnosis.report import words
from sim2real.loops.improve import steps
from sim2real.loops.relearn import Tried, closing, emulated
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import Interval
from sim2real.verbs.relearn import run

SHORT = ["iterations=1", "trials=2", "seconds=2", "algorithm.pairs=2", "env.task.seconds=0.4"]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Put a known answer in place of the diagnosis; return what it and each training were given."""
    given: dict[str, list[Any]] = {"diagnosed": [], "trained": []}
    real = steps.train

    def run_diagnosis(logs: list, *settings: Any) -> SimpleNamespace:
        given["diagnosed"].append(logs)
        return SimpleNamespace(report=None)

    def write(found: SimpleNamespace, folder: Path) -> None:
        folder.mkdir(exist_ok=True)
        write_effects(folder / "effects.yaml", [(make("command_delay"), (0.019,))])
        (folder / "report.json").write_text("{}")

    def trained(**settings: Any) -> Any:
        given["trained"].append([list(v) for _, v in settings["parts"].environment.fixed])
        return real(**settings)

    monkeypatch.setattr(steps, "run_diagnosis", run_diagnosis)
    monkeypatch.setattr(steps, "write", write)
    monkeypatch.setattr(words, "sentence", lambda report: "found")
    monkeypatch.setattr(steps, "train", trained)
    return given


def arguments(out: Path, *more: str) -> dict[str, Any]:
    """Return the arguments of a short run."""
    return prepare(compose(["+experiment=hopper2_gap", *SHORT, *more]), out)[1]


@pytest.mark.slow
def test_the_loop_is_closed_and_goes_on_where_it_stopped(
    tmp_path: Path, seen: dict[str, list[Any]]
) -> None:
    """Nominal, then what was found on the stand, then the truth; a second call repeats neither."""
    tried = run(**arguments(tmp_path))
    assert list(tried) == ["nominal", "corrected", "truth"]
    assert all(len(one.robot) == len(one.simulator) == 2 for one in tried.values())
    assert seen["trained"] == [[], [[0.019]], [[0.02]]]
    ((first, second),) = seen["diagnosed"]
    assert {log.path.name for log in (first, second)} == {"a.csv", "b.csv"}
    assert list(first.joints) == ["hip", "knee"]  # the rest of the robot is fixed
    assert not np.array_equal(first.column("ctrl.hip"), second.column("ctrl.hip"))
    kept = json.loads((tmp_path / "gap.json").read_text())
    assert kept["found"] == "command_delay 0.019"
    assert kept["policies"]["corrected"]["robot"] == tried["corrected"].robot
    assert (tmp_path / "plots" / "gap.png").is_file()
    again = run(**arguments(tmp_path / "other", f"resume={tmp_path}"))
    assert again["truth"].simulator == tried["truth"].simulator
    assert len(seen["diagnosed"]) == 1


@pytest.mark.slow
def test_what_the_robot_hides_is_in_its_logs_and_not_in_its_model(
    tmp_path: Path, seen: dict[str, list[Any]]
) -> None:
    """The diagnosis gets a nominal model, and recordings of a robot that lags behind it."""
    run(**arguments(tmp_path))
    ((log, _),) = seen["diagnosed"]
    assert "delay" not in json.dumps({k: v for k, v in log.meta.items() if k != "command_delay"})
    ((effect, values),) = load_effects("conf/shift/hopper2_delay.yaml")
    assert (effect.name, values[0]) == ("command_delay", 0.02)
    text = (tmp_path / "stand" / "model.xml").read_text()
    assert 'delay="0.001"' in text and "0.02" not in text.split("<actuator>")[1]


def test_the_share_that_is_closed() -> None:
    """From 1 to 2 of 3 is a half; without the truth it is not known."""
    tried = {
        name: Tried([3.0, 3.0], [level, level])
        for name, level in (("nominal", 1.0), ("corrected", 2.0), ("truth", 3.0))
    }
    assert closing(tried, np.random.default_rng(0)) == Interval(0.5, 0.5, 0.5)
    del tried["truth"]
    assert closing(tried, np.random.default_rng(0)) is None


def test_a_real_robot_is_refused() -> None:
    """Between the steps somebody has to hang it up: the sentence says how to do them."""
    robot = compose(["+experiment=hopper2_gap"])["robot"] | {"port": "/dev/ttyUSB0"}
    with pytest.raises(Sim2RealError, match="one by one"):
        emulated(robot)
