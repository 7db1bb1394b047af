"""How hot motors are when a window starts."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.effects.supply import _Derating
from envs.plant import Fixed, Plant
from envs.replay import rollout
from hardware.log import Log
from sim2real.diagnosis.data.simulate import Simulated, Simulator
from sim2real.diagnosis.inference.candidates import candidates
from tests.sim2real.diagnosis import arm


def test_heat_of_a_hold_is_torque_squared_times_time(tmp_path: Path) -> None:
    """Held still against gravity a motor needs m g l sin q."""
    held = Simulator(arm.data_of(_hold(), tmp_path)).heat.squares(0)[100:500, 0]
    weight = 9.81 * np.sin(0.35) * (0.3 * 0.1 + 0.2 * 0.3)  # where it comes to rest, 0.35 rad
    assert np.sqrt(held.mean()) == pytest.approx(weight, rel=0.1)


def test_heat_is_that_of_the_gains_that_are_known(tmp_path: Path) -> None:
    """A servo known to be half as stiff sags further, and its hold takes the torque of its load."""
    soft: list[Fixed] = [(make("position_gain", where="a"), (0.5,))]
    log = _hold(soft)
    angle = float(log.column("qpos.a")[-1])
    assert angle < 0.33  # 0.35 rad at the model's own gain
    held = Simulator(arm.data_of(log, tmp_path), soft).heat.squares(0)[100:500, 0]
    weight = 9.81 * np.sin(angle) * (0.3 * 0.1 + 0.2 * 0.3)
    assert np.sqrt(held.mean()) == pytest.approx(weight, rel=0.1)


def _hold(fixed: Sequence[Fixed] = ()) -> Log:
    """Return 12 s of the arm held at a goal of 0.4 rad."""
    ctrl = np.tile([0.4, 0.0], (1, 6000, 1))
    plant = Plant(arm.spec(), (), 1, threads=1, fixed=fixed)
    zero = np.zeros((1, 2))
    plant.reset(np.zeros(1, int), zero, zero, np.zeros(1, np.uint64), ctrl[:, 0], measured=True)
    path, time = rollout(plant, ctrl)[0, :-1:10], np.arange(600) / arm.RATE
    columns = {"episode": np.zeros(600), "time": time}
    columns |= {f"ctrl.{n}": ctrl[0, ::10, i] for i, n in enumerate("ab")}
    columns |= {f"qpos.{n}": path[:, i] for i, n in enumerate("ab")}
    return Log(columns)


def test_some_windows_of_a_log_tell_about_as_much_heat_as_all_of_them(tmp_path: Path) -> None:
    """What no window covers heats the motors too: a part of the windows must not look colder."""
    data = arm.data_of(_hold(), tmp_path)
    few = np.arange(len(data.windows))[1::3]
    whole, part = (
        np.trapezoid(Simulator(own).heat.squares(0)[:, 0], data.logs[0].time)
        for own in (data, data.only(few))
    )
    assert part == pytest.approx(whole, rel=0.25)  # all but the first moment, which is harder


def test_a_motor_that_is_off_where_no_window_is_stays_cold(tmp_path: Path) -> None:
    """What was not simulated heats a motor only while its torque is on."""
    log = _hold()
    off = Log({**log.columns, "torque.a": (log.time < 6.0).astype(float)})
    data = arm.data_of(off, tmp_path)
    early = [i for i, window in enumerate(data.windows) if window.last * 0.02 < 5.0]
    squares = Simulator(data.only(np.array(early))).heat.squares(0)[:, 0]
    assert squares[log.time > 6.0].max() == 0.0 < squares[log.time < 6.0].min()


@pytest.mark.parametrize(
    ("where", "braking", "value", "weaker"),
    [
        ("a", 0.0, 0.04, 0.2),
        pytest.param("a", 1.0, 0.04, 0.2, marks=pytest.mark.slow),
        pytest.param(None, 1.0, 0.4, 0.9, marks=pytest.mark.slow),
    ],
)
def test_windows_start_as_hot_as_one_long_replay_gets(
    tmp_path: Path, where: str | None, braking: float, value: float, weaker: float
) -> None:
    """What a weakening motor's torque comes to by each window's start is that of the whole log.

    Where its damping is no current, that of the torque before it. Where one motor has given way,
    that of the others with what hangs there.
    """
    effect = "thermal_derating"
    arguments: dict[str, Any] = {"where": where, "braking": braking}
    data = arm.data_of(arm.make_log((effect, arguments, value), seconds=20.0), tmp_path)
    windows = np.arange(len(data.windows))
    plants = [Plant(data.specs[0], [make(effect, **arguments)], n) for n in (len(windows), 1)]
    for plant in plants:
        plant.set_params(np.arange(plant.num_rows), np.full((plant.num_rows, 1), value))
    rules = [next(r for r in p.substep_rules if isinstance(r, _Derating)) for p in plants]
    Simulator(data).heat.start(plants[0], windows)
    truth = arm.replay_whole(plants[1], data.logs[0], lambda: rules[1].heat[0])
    expected = truth[[window.start for window in data.windows]]
    assert (expected * value).max() > weaker  # a motor is weaker by so much
    np.testing.assert_allclose(rules[0].heat, expected, rtol=0.07, atol=0.05)


@pytest.mark.slow
def test_the_true_derating_leaves_no_error_in_later_windows(tmp_path: Path) -> None:
    """Windows that start hot are simulated hot: the truth explains the last ones, too."""
    effect = ("thermal_derating", {"where": "a"}, 0.04)
    data = arm.data_of(arm.make_log(effect, seconds=20.0), tmp_path)
    (option,) = (o for o in candidates(data) if o.label == "thermal_derating.a")
    simulator, every = Simulator(data), np.arange(len(data.windows))
    right, wrong = (
        simulator.run((option.effect,), every, np.full((len(every), 1), value)).error
        for value in (0.04, 0.0)
    )
    late = [i for i, w in enumerate(data.windows) if w.first > len(data.logs[0]) // 2]
    assert np.square(right[late]).mean() < 0.1 * np.square(wrong[late]).mean()


def test_what_the_logs_heat_is_worked_out_before_it_is_shared(tmp_path: Path) -> None:
    """Processes find it known: none of them has to simulate the logs for itself."""
    data = arm.data_of(arm.make_log(seconds=20.0), tmp_path)
    (option,) = (c for c in candidates(data) if c.label == "thermal_derating.a")
    simulator, told = Simulator(data, threads=1), []
    together = simulator.together

    def noted(tasks: Sequence[Callable[[], Simulated]]) -> list[Simulated]:
        told.append(set(simulator.heat._known))
        return together(tasks)

    simulator.together = noted
    windows = np.arange(len(data.windows))
    simulator.run((option.effect,), windows, np.tile(option.probes[:1], (len(windows), 1)))
    assert told == [{(0, None), (0, 0)}]
