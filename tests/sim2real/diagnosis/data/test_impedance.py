"""Logs whose rows bring gains: what they mean in a model, and which are refused."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from envs.plant import Plant
from envs.replay import Recording, replay, switchable, with_impedance
from hardware.log import Log, LogError
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.impedance import laws_of, with_laws
from sim2real.diagnosis.data.replay import measure
from tests.sim2real.diagnosis import arm, motors


def rows(seconds: float = 4.0, seed: int = 0) -> dict[str, np.ndarray]:
    """Return a walk's columns: stiff for half a second, soft for the next, with feed-forward."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * motors.RATE)) / motors.RATE
    stiff = (time % 1.0 < 0.5).astype(float)
    columns = {"episode": np.zeros(len(time)), "time": time}
    for name, phase in (("a", 0.3), ("b", 1.1)):
        wave = 2 * np.pi * rng.uniform(0.3, 0.7)
        columns[f"ctrl.{name}"] = 0.6 * np.sin(wave * time + phase)
        columns[f"qvel_des.{name}"] = 0.6 * wave * np.cos(wave * time + phase)
        columns[f"kp.{name}"] = 3.0 + 9.0 * stiff
        columns[f"kd.{name}"] = 0.2 + 0.3 * stiff
        columns[f"torque_ff.{name}"] = 0.1 * np.sin(5 * time)
    return columns


def make_log(columns: Mapping[str, np.ndarray], *effects: tuple[str, dict, float]) -> Log:
    """Return what an arm of motors does under such rows, made by the replay engine."""
    count = len(columns["time"])
    blank = {f"qpos.{name}": np.zeros(count) for name in "ab"}
    spec = with_laws(motors.spec(), Log({**columns, **blank}))
    law = laws_of(Log({**columns, **blank}), spec.copy().compile())
    fixed = [(make(name, **arguments), (value,)) for name, arguments, value in effects]
    ctrl = np.column_stack([columns[f"ctrl.{name}"] for name in "ab"])
    recording = Recording(columns["time"], ctrl, np.zeros(2), np.zeros(2), law=law)
    path = replay(Plant(switchable(spec), fixed=fixed, threads=1), [recording])[0]
    return Log({**columns, "qpos.a": path[:, 0], "qpos.b": path[:, 1]})


def test_a_log_with_gains_is_its_own_replay() -> None:
    """Nothing is left where nothing was changed, and friction leaves a gap at its joint."""
    same = measure(make_log(rows()), motors.spec()).errors()
    assert max(error["rmse"] for error in same.values()) < 1e-9
    held = ("coulomb_friction", {"where": "b"}, 0.1)
    gap = measure(make_log(rows(), held), motors.spec()).errors()
    assert gap["b"]["rmse"] > 0.01
    without = {n: c for n, c in rows().items() if n.partition(".")[0] not in ("kp", "kd")}
    without = {
        n: c for n, c in without.items() if n.partition(".")[0] in ("episode", "time", "ctrl")
    }
    plain = Log({**without, **{n: c for n, c in make_log(rows()).columns.items() if "qpos" in n}})
    assert measure(plain, motors.spec()).errors()["b"]["rmse"] > 0.1


def test_windows_know_the_rows_gains(tmp_path: Path) -> None:
    """A window in the middle of an episode has the gains of its own rows."""
    log = make_log(rows())
    data = Data.of([log], motors.model(tmp_path))
    assert len(data.windows) > 1
    for window in data.windows:
        law = window.recording.law
        assert law is not None
        assert law[:, 0, 0] == pytest.approx(log.columns["kp.a"][window.start : window.last])


@pytest.mark.parametrize("kind", ["kd", "qvel_des", "torque_ff"])
def test_a_law_without_its_gain_is_refused(kind: str, tmp_path: Path) -> None:
    """The sentence names both columns."""
    log = arm.make_log(seconds=2.0)
    lame = Log({**log.columns, f"{kind}.a": np.ones(len(log))})
    with pytest.raises(LogError, match=rf"`{kind}.a` and no `kp.a`.*0 where it is off"):
        Data.of([lame], arm.model(tmp_path))


def test_a_negative_gain_is_refused(tmp_path: Path) -> None:
    """With its row and column."""
    log = arm.make_log(seconds=2.0)
    gain = np.ones(len(log))
    gain[7] = -2.0
    with pytest.raises(LogError, match=r"row 7, column 'kp.a': a gain of -2 is negative"):
        Data.of([Log({**log.columns, "kp.a": gain})], arm.model(tmp_path))


def test_gains_of_an_actuator_that_can_have_none_are_refused(tmp_path: Path) -> None:
    """An actuator with a state of its own (an integrated velocity) takes no such rows."""
    text = arm.XML.replace(
        '<position name="a" joint="a" kp="8" damping="0.4" forcerange="-3 3"/>',
        '<intvelocity name="a" joint="a" kp="8" actrange="-2 2"/>',
    )
    (tmp_path / "arm.xml").write_text(text, encoding="utf-8")
    log = arm.make_log(seconds=2.0)
    gains = {"kp.a": np.ones(len(log)), "kd.a": np.ones(len(log))}
    with pytest.raises(LogError, match="gains of a: actuator 'a' of the model cannot have"):
        Data.of([Log({**log.columns, **gains})], tmp_path / "arm.xml")


def test_the_model_may_call_the_motor_a_servo() -> None:
    """The rows' gains take the place of the servo's own."""
    spec = arm.spec()
    own = with_impedance(spec, {"a": (8.0, 0.0), "b": (6.0, 0.0)}).compile()
    assert own.actuator_biasprm[:, 1].tolist() == [-8.0, -6.0]
