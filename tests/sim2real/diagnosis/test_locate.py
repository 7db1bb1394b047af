"""The gap is placed where it was put: joint, kind of moment, frequency, side of approach."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.data.recording import to_recording
from sim2real.diagnosis.data.regimes import regimes
from sim2real.diagnosis.data.replay import Gap
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.locate import bands, locate
from sim2real.diagnosis.schema import JointGap

ARM = """
<mujoco><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="shoulder" axis="0 1 0" armature="0.005"/>
<geom type="capsule" fromto="0 0 0 0 0 -.15" size=".01" mass="0.2"/>
<body pos="0 0 -.15"><joint name="elbow" axis="0 1 0" armature="0.005"/>
<geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass="0.1"/></body></body></worldbody>
<actuator><position name="a" joint="shoulder" kp="4" kv="0.2"/>
<position name="b" joint="elbow" kp="4" kv="0.2"/></actuator></mujoco>
"""
RATE = 50


def commands(seconds: float) -> dict[str, np.ndarray]:
    """Return steps that are held, after a while with sines."""
    time = np.arange(0, seconds, 1 / RATE)
    levels = np.random.default_rng(1).uniform(-0.6, 0.6, (2, len(time) // (2 * RATE) + 1))
    steps = levels[:, (time / 2).astype(int)]
    sines = 0.5 * np.sin(2 * np.pi * np.array([[0.8], [1.1]]) * time)
    ctrl = np.where(time < seconds / 2, steps, sines)
    return {"episode": 0 * time, "time": time, "ctrl.a": ctrl[0], "ctrl.b": ctrl[1]}


def gap_of(error: dict[str, np.ndarray] | None = None, effects: tuple = (), path: str = "x.csv"):
    """Return a gap: what a robot with effects, or with these errors in its readings, does."""
    spec, columns = mujoco.MjSpec.from_string(ARM), commands(24.0)
    zero = 0 * columns["time"]
    log = Log({**columns, "qpos.shoulder": zero, "qpos.elbow": zero})
    model = spec.compile()
    recording = to_recording(log, model)
    (simulated,) = trial(spec, [recording])
    (real,) = trial(spec, [recording], fixed=effects)
    for i, joint in enumerate(("shoulder", "elbow")):
        real[:, i] -= (error or {}).get(joint, 0.0)
    measured = {"qpos.shoulder": real[:, 0], "qpos.elbow": real[:, 1]}
    log = Log({**columns, **measured}, {}, Path(path))
    return Gap(log, ("shoulder", "elbow"), real, simulated), spec


def located(gap: Gap, spec: mujoco.MjSpec, after: tuple = ()) -> tuple[JointGap, ...]:
    """Return where one gap lies."""
    rng = np.random.default_rng(0)
    return locate([gap], np.zeros(len(gap.joints)), [spec.compile()], after, rng=rng)


def test_the_joint_with_the_friction_has_the_gap() -> None:
    """Dry friction in the elbow: nearly all of the gap there, at no kind of moment above all."""
    gap, spec = gap_of(effects=((make("coulomb_friction", where="elbow"), [0.15]),))
    where = located(gap, spec)
    assert where[0].joint == "elbow"
    assert where[0].share > 0.9
    assert where[0].regimes == ()  # it is off as often as it moves


@pytest.mark.parametrize("name", ["fast", "high position", "reversal", "last third of the time"])
def test_an_error_in_one_kind_of_moment_is_named(name: str) -> None:
    """Readings that are wrong at those moments alone: the kind is the joint's first regime."""
    gap, spec = gap_of()
    kinds = regimes(gap.log, spec.compile(), "shoulder")
    (rows,) = [rows for _, kind, rows in kinds if kind == name]
    rng = np.random.default_rng(2)
    wrong = np.where(rows, 0.02 * rng.normal(size=len(rows)), 0.0)
    shifted = gap._replace(measured=gap.measured + wrong[:, None] * [1, 0])
    where = located(shifted, spec)
    assert where[0].joint == "shoulder"
    (regime,) = [regime for regime in where[0].regimes if regime.name == name]
    square = (shifted.simulated - shifted.measured)[:, 0] ** 2
    assert regime.share == pytest.approx(square[rows].sum() / square.sum())


def test_a_gap_after_the_correction_stands_beside_the_one_before() -> None:
    """Errors are quoted with and without the causes, by joint."""
    gap, spec = gap_of(effects=((make("coulomb_friction", where="elbow"), [0.15]),))
    right = gap._replace(simulated=gap.measured + 1e-3)
    where = located(gap, spec, after=(right,))
    assert where[0].after == pytest.approx(1e-3)


def test_noise_below_the_floor_is_no_gap() -> None:
    """A joint whose error is all noise has no share of the gap."""
    rng = np.random.default_rng(3)
    gap, spec = gap_of()
    noise = rng.normal(0, 0.01, gap.measured.shape) * [1, 0] + [0, 0.02]
    noisy = gap._replace(measured=gap.measured + noise)
    where = locate([noisy], np.array([0.0102, 0.0]), [spec.compile()], rng=rng)
    assert where[0].joint == "elbow"
    assert where[0].share > 0.99


def test_bands_hold_the_whole_gap_where_it_is() -> None:
    """A 3 Hz error lies in the band of 2 to 5 Hz, and the bands add up to the whole."""
    time = commands(24.0)["time"]
    gap, _ = gap_of(error={"elbow": 0.01 * np.sin(2 * np.pi * 3 * time)})
    own = [band for band in bands([gap], np.array([0.0, 1e-4])) if band.joint == "elbow"]
    top = max(own, key=lambda band: band.before)
    assert (top.low, top.high) == (2.0, 5.0)
    whole = np.sqrt(sum(band.before**2 for band in own))
    assert whole == pytest.approx(0.01 / np.sqrt(2), rel=0.02)


def test_a_free_base_is_placed_too() -> None:
    """Positions of a joint with seven numbers get shares of their own, without a load."""
    gap, spec = gap_of()
    base = {f"qpos.root.{k}": gap.log.time for k in range(7)}
    log = Log({**gap.log.columns, **base}, {}, gap.log.path)
    wide = gap._replace(
        log=log,
        joints=(*gap.joints, "root.2"),
        measured=np.column_stack([gap.measured, log.time]),
        simulated=np.column_stack([gap.simulated, log.time + 0.1]),
    )
    where = located(wide, spec)
    assert where[0].joint == "root.2"
    assert "load" not in {group for group, *_ in regimes(log, spec.compile(), "root.2")}
