"""The verb identify: from a log to distribution.yaml, which training takes; and what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.distribution_file import read
from envs.effects import make
from envs.params import ParamSpace
from envs.randomization import Draw, Randomization
from hardware.log import Log, write_log
from sim2real.config.compose import compose, instantiate
from sim2real.config.folders import check_paths_exist
from sim2real.config.targets import ConfigError
from sim2real.diagnosis.schema import Cause, Equivalent, GapMetrics, Report, Unexplained
from sim2real.identification.methods.matching import Matching
from sim2real.identification.scores.aligned import KStep, OneStep
from sim2real.identification.searches import Cma
from sim2real.learning.environment import make_env
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs import identify
from tests.sim2real.diagnosis import arm

FRICTION = ("coulomb_friction", {"where": "a"}, 0.1)
NONE = Randomization()
RANGES = Randomization([Draw(make("coulomb_friction", where="a"), low=0.0, high=0.5)])


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return three seconds of an arm with friction in one joint."""
    folder = tmp_path_factory.mktemp("logs")
    arm.model(folder)
    made = arm.make_log(FRICTION, seconds=3.0, noise=1e-3)
    return write_log(folder / "arm.csv", Log(made.columns, {"model": "arm.xml"}))


def go(out: Path, log: Path | None, **changes: Any) -> Any:
    """Identify, quickly."""
    given: dict[str, Any] = {
        "log": log and str(log), "model": None, "effects": None, "candidates": None,
        "params": RANGES, "identify": Matching(KStep(), Cma(generations=6)), "seed": 0,
        "checkpoint": None, "resume": None, "out": out,
    }  # fmt: skip
    return identify.run(**(given | changes))


def report(folder: Path, *causes: Cause) -> Path:
    """Write the report of a diagnosis."""
    gap = GapMetrics("rad", 0.02, 0.002, 0.001, 0.95, (0.9, 0.97), True)
    made = Report("explained", gap, (), causes, Unexplained(0.05, "none"))
    return made.write(folder / "report.json")


def cause(effect: str, value: float, ci: tuple[float, float], *equivalent: str) -> Cause:
    """Return a cause at the first joint."""
    same = tuple(Equivalent(name, "a") for name in equivalent)
    return Cause(effect, "a", None, value, ci, "N·m", {}, 0.9, 0.9, "holds", same)


def test_a_log_becomes_a_distribution(tmp_path: Path, log: Path) -> None:
    """All files are there, the friction is found, and the picture and table name it."""
    outcome = go(tmp_path, log)
    found = read(tmp_path / "distribution.yaml")
    assert found.names == ("coulomb_friction.a",)
    assert found.mean == pytest.approx([0.1], rel=0.03)
    assert list(found.logs) == ["arm.csv"] and len(found.logs["arm.csv"]) == 64
    assert found.made_by["method"] == "matching"
    assert (tmp_path / "plots" / "parameters.png").stat().st_size > 5000
    assert "coulomb_friction.a" in (tmp_path / "table.md").read_text()
    told = json.loads((tmp_path / "identify.json").read_text())
    assert told["held_out"]["after"] == outcome.judged.after < outcome.judged.before
    assert {p.name for p in tmp_path.iterdir()} == {
        *("distribution.yaml", "identify.json", "journal.npz", "plots", "table.csv", "table.md")
    }


@pytest.mark.slow
def test_a_stopped_run_resumes(tmp_path: Path, log: Path) -> None:
    """What was told is not asked again, and the run ends where the whole one did."""
    whole = go(tmp_path / "whole", log)
    short = Matching(KStep(), Cma(generations=3))
    short.search.minimize = _stopping(short.search.minimize)  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        go(tmp_path / "short", log, identify=short)
    assert {p.name for p in (tmp_path / "short").iterdir()} == {"journal.npz"}
    asked = _Counting()
    resumed = go(
        tmp_path / "resumed",
        log,
        resume=str(tmp_path / "short"),
        identify=Matching(asked, Cma(generations=6)),
    )
    assert asked.calls == 6 - 2
    np.testing.assert_array_equal(resumed.found.mean, whole.found.mean)
    first, last = (tmp_path / name / "distribution.yaml" for name in ("whole", "resumed"))
    assert first.read_text().replace("KStep", "") == last.read_text().replace("_Counting", "")


def _stopping(minimize: Any) -> Any:
    """Return a search that is interrupted after two generations."""

    def stopped(evaluate: Any, *rest: Any) -> Any:
        def once(points: np.ndarray, turn: int) -> np.ndarray:
            if turn == 2:
                raise KeyboardInterrupt
            return evaluate(points, turn)

        return minimize(once, *rest)

    return stopped


class _Counting(KStep):
    """A score that counts its calls."""

    calls = 0

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        self.calls += 1
        return super().__call__(real, simulated, turn)


def test_a_journal_of_another_search_is_refused(tmp_path: Path, log: Path) -> None:
    """So are a damaged one and a folder without."""
    go(tmp_path / "a", log)
    with pytest.raises(Sim2RealError, match="generation 1 evaluated other points"):
        go(tmp_path / "b", log, resume=str(tmp_path / "a"), seed=1)
    (tmp_path / "a" / "journal.npz").write_bytes(b"PK nothing")
    with pytest.raises(Sim2RealError, match="is damaged"):
        go(tmp_path / "b", log, resume=str(tmp_path / "a"))
    with pytest.raises(Sim2RealError, match="resume: no"):
        go(tmp_path / "b", log, resume=str(tmp_path / "none"))


def test_a_diagnosis_is_a_prior(tmp_path: Path, log: Path) -> None:
    """A cause's interval times three about its value, an equivalent's whole range."""
    path = report(tmp_path, cause("coulomb_friction", 0.09, (0.08, 0.11), "viscous_friction"))
    outcome = go(tmp_path / "out", log, candidates=str(path), params=NONE)
    first, second = outcome.prior.laws
    assert outcome.prior.names == ("coulomb_friction.a", "viscous_friction.a")
    assert (first.low, first.high) == pytest.approx((0.06, 0.15))
    assert second.low == 0.0 < second.high
    assert outcome.found.mean[0] == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"params": NONE}, r"needs a prior: give candidates="),
        ({"candidates": ["coulomb_friction"]}, "are two priors"),
        ({"candidates": ["coulom_friction"], "params": NONE}, "did you mean 'coulomb_friction'"),
        ({"candidates": [], "params": NONE}, "names no effect"),
        (
            {
                "params": Randomization(
                    [Draw(make("coulomb_friction", where="a"), low=0.1, high=0.1)]
                )
            },
            "the prior of coulomb_friction.a has no width",
        ),
        ({"identify": Matching(OneStep(), Cma())}, "has no qvel.a, but a score that starts"),
    ],
    ids=["none", "two", "unknown", "empty", "no width", "no state"],
)
def test_what_cannot_work_is_refused(tmp_path, log: Path, changes: dict, message: str) -> None:
    """A sentence each, before any work: nothing is written."""
    with pytest.raises(Sim2RealError, match=message):
        go(tmp_path / "out", log, **changes)
    assert not (tmp_path / "out").exists()


def test_a_log_is_needed(tmp_path: Path) -> None:
    """Without one there is nothing to identify."""
    with pytest.raises(Sim2RealError, match="give log=PATH"):
        go(tmp_path / "out", None)


def test_reports_that_are_none_are_refused(tmp_path: Path, log: Path) -> None:
    """Not JSON, and a diagnosis without causes."""
    (tmp_path / "report.json").write_text("{}")
    with pytest.raises(Sim2RealError, match="schema"):
        go(tmp_path / "out", log, candidates=str(tmp_path), params=NONE)
    (tmp_path / "report.json").write_text("no")
    with pytest.raises(Sim2RealError, match=r"is not a report\.json"):
        go(tmp_path / "out", log, candidates=str(tmp_path), params=NONE)
    report(tmp_path)
    with pytest.raises(Sim2RealError, match="without a cause"):
        go(tmp_path / "out", log, candidates=str(tmp_path), params=NONE)


def test_the_command_line_composes_it(tmp_path: Path, log: Path) -> None:
    """Score and search are chosen by their groups; names in brackets are no paths."""
    words = ["run=identify", f"log={log}", "candidates=[coulomb_friction]"]
    tree = compose([*words, "identify/score=likelihood", "identify.search.generations=4"])
    check_paths_exist(tree, {"log", "candidates"})
    verb, arguments = instantiate(tree, tmp_path)
    assert verb is identify.run
    assert type(arguments["identify"].score).__name__ == "Likelihood"
    assert arguments["identify"].search.generations == 4
    with pytest.raises(ConfigError, match=r"no such choice.*one_step"):
        compose([*words, "identify/score=onestep"])
    tree = compose(["run=identify", f"log={log}", "candidates=nowhere/report.json"])
    with pytest.raises(ConfigError, match="no such file"):
        check_paths_exist(tree, {"log", "candidates"})


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without cma the extra is named."""
    monkeypatch.setattr("sim2real.identification.searches.find_spec", lambda name: None)
    with pytest.raises(Sim2RealError, match=r"pip install 'sim2real\[identify\]'"):
        Cma()


def test_training_draws_from_it(tmp_path: Path) -> None:
    """params=distribution gives every episode its robot, and the label that it carries."""
    path = tmp_path / "distribution.yaml"
    path.write_text(
        "entries:\n- {effect: link_mass, where: torso, extra: {how: scale}, law: normal,\n"
        "   mean: 1.5, std: 0.05, low: 1.2, high: 1.8}\n"
    )
    env = make_env(compose(["env=hopper", "params=distribution", f"params.path={path}"]), 64)
    drawn = env.reset()["params", "link_mass.torso"].numpy()
    assert drawn.mean() == pytest.approx(1.5, abs=0.03)
    assert drawn.std() == pytest.approx(0.05, rel=0.4)
    with pytest.raises(ValueError, match="the simulation has 0"):
        read(path).check(ParamSpace())
