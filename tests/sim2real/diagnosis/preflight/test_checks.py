"""Preflight names the commonest mistakes, and says nothing of a log that is right."""

import os
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.log import Log, read_log, read_logs, write_log
from sim2real.diagnosis.data.noise_floor import noise_floor, step_of
from sim2real.diagnosis.data.recording import load_model, to_recording
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.preflight.checks import NOTES, preflight
from sim2real.diagnosis.preflight.lag import check_lag

COUNT = 2 * np.pi / 4096
ARM = """
<mujoco><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="shoulder" axis="0 1 0" armature="0.005" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0 0 -.15" size=".01" mass="0.2"/>
<body pos="0 0 -.15"><joint name="elbow" axis="0 1 0" armature="0.005" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass="0.1"/></body></body></worldbody>
<actuator><position name="a" joint="shoulder" kp="4" kv="0.1" forcerange="-2 2"/>
<position name="b" joint="elbow" kp="4" kv="0.1" forcerange="-2 2"/></actuator></mujoco>
"""
DATA = os.environ.get("SIM2REAL_DATA")
real = pytest.mark.skipif(DATA is None, reason="real logs: set SIM2REAL_DATA to their folder")


def spec() -> mujoco.MjSpec:
    """Return the two-joint arm."""
    return mujoco.MjSpec.from_string(ARM)


def make_log(seconds: float = 8.0, late: tuple[float, ...] = ()) -> Log:
    """Return what the arm itself does, read by an encoder; commands come late from then on."""
    time = np.arange(0, seconds, 0.02)
    a = 0.6 * np.sin(2 * np.pi * 0.5 * time) + 0.2 * np.sin(2 * np.pi * 1.3 * time)
    b = 0.4 * np.sin(2 * np.pi * 0.7 * time + 1) + 0.3
    columns = {"episode": 0 * time, "time": time, "ctrl.a": a, "ctrl.b": b}
    columns |= {"qpos.shoulder": 0 * time, "qpos.elbow": 0 * time + b[0]}
    heard = dict(columns)
    for start in late:
        for name in ("ctrl.a", "ctrl.b"):
            slow = np.interp(time - 0.06, time, columns[name])
            heard[name] = np.where(time > start, slow, columns[name])
    model = spec().compile()
    (path,) = trial(spec(), [to_recording(Log(heard), model)])
    q = COUNT * np.round(path / COUNT)
    columns |= {"qpos.shoulder": q[:, 0], "qpos.elbow": q[:, 1]}
    force = 4 * (np.roll(np.column_stack([a, b]), 1, axis=0) - q) / 2
    columns |= {"sensor.duty_a": force[:, 0], "sensor.duty_b": force[:, 1]}
    for i, name in enumerate(("shoulder", "elbow")):
        columns[f"qvel.{name}"] = np.gradient(path[:, i], time)
    return Log(columns)


def changed(log: Log, names: list[str], factor: float = 1.0, shift: float = 0.0) -> Log:
    """Return the log with some columns scaled and shifted."""
    new = {name: factor * log.column(name) + shift for name in names}
    return Log({**log.columns, **new}, log.meta, log.path)


def without(log: Log, *kinds: str) -> Log:
    """Return the log without the columns of these kinds."""
    return Log({n: v for n, v in log.columns.items() if n.split(".")[0] not in kinds}, log.meta)


def named(log: Log) -> dict[tuple[str, str | None], str]:
    """Return what preflight finds worth mending: check and place to fix."""
    found = preflight([log], [spec()])
    return {(f.check, f.where): f.fix for f in found if f.check not in NOTES}


def test_a_right_log_has_nothing_to_mend() -> None:
    """The model's own motion raises no finding but notes on its encoder."""
    assert named(make_log()) == {}
    notes = {f.check for f in preflight([make_log()], [spec()])}
    assert notes == {"quantization"}


def test_commands_that_were_not_logged_are_named() -> None:
    """Without `ctrl.b` the simulation holds the elbow, and no effect explains that."""
    log = make_log()
    rest = Log({n: v for n, v in log.columns.items() if n != "ctrl.b"}, log.meta)
    assert "`ctrl.b`" in named(rest)["no_command", "elbow"]


@pytest.mark.parametrize("factor", [180 / np.pi, -1.0, 2.0])
def test_a_speed_of_another_unit_or_sign_is_named_once(factor: float) -> None:
    """All joints alike are one finding; a joint alone is named."""
    log = without(make_log(), "sensor")
    fixes = named(changed(log, ["qvel.shoulder", "qvel.elbow"], factor))
    assert list(fixes) == [("speed", None)]
    said = float(re.findall(r"`qvel` by (-?[\d.]*\d)", fixes["speed", None])[0])
    assert said == pytest.approx(factor, rel=0.02)
    assert list(named(changed(log, ["qvel.elbow"], factor))) == [("speed", "elbow")]


def test_another_unit_shows_in_a_range_that_a_model_has() -> None:
    """A log that hardly moves, all of it in degrees: no replay tells which unit, so it is asked."""
    limited = ARM.replace('name="elbow"', 'name="elbow" range="-90 90" limited="true"')
    log = without(make_log(), "sensor")
    still = changed(log, ["qpos.elbow", "ctrl.b", "qvel.elbow"], 0.01, 1.0)
    names = [n for n in log.columns if n.split(".")[0] in ("qpos", "ctrl", "qvel")]
    model = mujoco.MjSpec.from_string(limited)
    found = preflight([changed(still, names, 180 / np.pi)], [model])
    (unit,) = [f for f in found if f.check == "range"]
    assert "elbow runs from" in unit.finding and "columns.yaml" in unit.fix
    assert "range" not in {f.check for f in preflight([still], [model])}


def test_a_turn_in_command_and_reading_is_out_of_range() -> None:
    """No radians reach there, whatever the unit is."""
    limited = ARM.replace('name="elbow"', 'name="elbow" range="-150 150" limited="true"')
    log = without(make_log(), "sensor", "qvel")
    turned = changed(log, ["qpos.elbow", "ctrl.b"], shift=2 * np.pi)
    found = preflight([turned], [mujoco.MjSpec.from_string(limited)])
    assert ("range", "elbow") in {(f.check, f.where) for f in found}


def test_what_was_mended_at_reading_is_told(tmp_path: Path) -> None:
    """As a note: whoever knows the log can say whether that is right."""
    log = without(make_log(), "sensor")
    path = write_log(tmp_path / "a.csv", Log({**log.columns, "time": 1e3 * log.time}))
    (note,) = [f for f in preflight([read_log(path)], [spec()]) if f.check == "reading"]
    assert "a.csv: time is read as milliseconds" in note.finding and "reading" in NOTES


def test_a_wrong_rate_shows_in_the_speeds() -> None:
    """Stamps at half their distance: every speed is half the change of its position."""
    fixes = named(without(changed(make_log(), ["time"], 0.5), "sensor"))
    factor = float(re.findall(r"`qvel` by ([\d.]*\d)", fixes["speed", None])[0])
    assert factor == pytest.approx(0.5, rel=0.02) and "clock" in fixes["speed", None]


def test_metadata_and_stamps_that_disagree_are_named() -> None:
    """The rate that the recorder promised is compared with the stamps."""
    log = make_log()
    fixes = named(Log(log.columns, {"rate": 100.0}))
    assert "multiply `time` by 0.5" in fixes["rate", None]


def test_the_duty_law_gives_the_gain() -> None:
    """Half the duty for each rad of error: half the model's gain."""
    log = changed(make_log(), ["sensor.duty_a"], 0.5)
    fixes = named(log)
    assert "kp by 0.50" in fixes["control_law", "a"]
    soft = Log(log.columns, {"settings": {"a": {"operating_mode": 5}}})
    assert ("control_law", "a") not in named(soft), "its limit is one of current, not of duty"


def test_a_duty_of_uneven_rows_whose_command_is_late_gives_the_gain() -> None:
    """Were some rows given the command before it, or after it, the gain would seem lower."""
    log = make_log()
    uneven = log.time + np.random.default_rng(0).uniform(-2e-3, 2e-3, len(log))
    rows = np.arange(len(log))
    heard, follows = (log.column("ctrl.a")[np.maximum(rows - late, 0)] for late in (2, 3))
    duty = {"qpos.shoulder": follows, "sensor.duty_a": 4 * (heard - follows) / 2}
    late = Log({**log.columns, "time": uneven, **duty})
    assert ("control_law", "a") not in named(late)


def test_a_still_joint_and_one_that_never_turns_back_are_named() -> None:
    """Excitation is judged joint by joint."""
    log = make_log()
    still = changed(log, ["ctrl.b", "qpos.elbow", "qvel.elbow", "sensor.duty_b"], 0.0)
    assert "run=record motions=[ramp,chirp,steps]" in named(still)["excitation", "elbow"]
    ramp = Log({**without(log, "sensor", "qvel").columns, "qpos.elbow": 0.1 * log.time})
    assert "run=record motions=[ramp]" in named(ramp)["reversals", "elbow"]


def test_repeated_readings_and_gaps_are_named() -> None:
    """Every tenth reading is the last one again; and a second is missing."""
    log = make_log()
    q = log.column("qpos.shoulder").copy()
    q[5::10] = q[4::10]
    fixes = named(Log({**log.columns, "qpos.shoulder": q}))
    assert ("packet_loss", "shoulder") in fixes
    kept = (log.time < 4) | (log.time > 5)
    assert ("gaps", None) in named(Log({n: v[kept] for n, v in log.columns.items()}))


def test_a_late_speed_is_a_note() -> None:
    """A speed that trails by 30 ms is told, and is no mistake."""
    log = make_log()
    speed = np.interp(log.time - 0.03, log.time, log.column("qvel.elbow"))
    found = preflight([Log({**log.columns, "qvel.elbow": speed})], [spec()])
    (late,) = [f for f in found if f.check == "velocity_filter"]
    assert late.where == "elbow"
    delay = float(re.findall(r"comes ([\d.]+) ms", late.finding)[0])
    assert delay == pytest.approx(30, abs=1)
    assert "clock" not in {f.check for f in found}, "a filter is late: that is no other clock"


def test_a_lag_that_jumps_within_a_log_is_found() -> None:
    """Commands that come 60 ms later from 15 s on; a constant lag is left to the diagnosis."""
    model = spec().compile()
    assert list(check_lag([(make_log(30.0, late=(-1.0,)), model)], [spec()])) == []
    (found,) = check_lag([(make_log(30.0, late=(15.0,)), model)], [spec()])
    assert "until 1" in found.finding


def test_the_floor_is_the_scatter_of_repeats_or_a_count() -> None:
    """Noise of 5 mrad on ten repeats is found; a log without repeats has a count's share."""
    log = make_log(4.0)
    rng = np.random.default_rng(0)
    logs = [
        Log(
            {**log.columns, "qpos.elbow": log.column("qpos.elbow") + rng.normal(0, 0.005, len(log))}
        )
        for _ in range(10)
    ]
    assert noise_floor(logs)["elbow"] == pytest.approx(0.005, rel=0.2)
    assert noise_floor([log])["elbow"] == pytest.approx(COUNT / np.sqrt(12), rel=0.3)
    logs[0].columns["qpos.elbow"][150:156] += 0.4  # held up once
    assert noise_floor(logs)["elbow"] == pytest.approx(0.005, rel=0.2)
    assert step_of(log.column("qpos.elbow")) == pytest.approx(COUNT, rel=1e-6)
    assert step_of(rng.normal(size=100)) == 0.0


def test_a_joint_that_moved_a_few_counts_is_known_to_no_better_than_one() -> None:
    """A row that falls on each of three values shows a step; three values of three rows do not."""
    log = make_log(4.0)
    few = COUNT * np.minimum(np.arange(len(log)) // 10, 3)
    few = Log({**log.columns, "qpos.elbow": few})
    assert step_of(few.column("qpos.elbow")) == pytest.approx(COUNT)
    assert noise_floor([few])["elbow"] == pytest.approx(COUNT / np.sqrt(12), rel=0.3)
    assert step_of(np.array([0.1, 0.13, 0.4])) == 0.0


@real
def test_the_real_servo_tells_its_gain_divisor() -> None:
    """The PWM column of the XL330 logs gives half the manual's gain, from every log alike."""
    logs = read_logs(Path(str(DATA)) / "xl330_bench")
    found = preflight(logs, [load_model(log, None) for log in logs])
    (law,) = [f for f in found if f.check == "control_law"]
    assert "kp by 0.51" in law.fix or "kp by 0.50" in law.fix
    assert not {"speed", "range", "rate"} & {f.check for f in found}


@real
@pytest.mark.slow
def test_the_real_arm_has_no_mistakes() -> None:
    """Signs, order, zeros and units of the SO-101 logs are right; the floor is 0.1 degrees."""
    logs = read_logs(Path(str(DATA)) / "so101")
    shared = load_model(logs[0], None)
    found = preflight(logs, [shared] * len(logs))
    assert not {"speed", "range", "rate", "lag"} & {f.check for f in found}
    floor = noise_floor(logs)
    assert all(0.05 < np.rad2deg(floor[joint]) < 0.2 for joint in logs[0].joints[:5])
