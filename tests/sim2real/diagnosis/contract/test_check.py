"""Each fault of an interface is named with its place and fix, and nothing else is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.contract.answer import Answer
from sim2real.diagnosis.contract.check import check_contract
from sim2real.diagnosis.contract.terms import ContractError
from tests.sim2real.diagnosis.contract.walk import (
    JOINTS,
    KD,
    KP,
    POSE,
    SCALE,
    described,
    older,
    raw,
    turn,
    walk,
)

SWAP = [2, 3, 0, 1]
SIZES = [3, 3, 2, 4, 4, 4]
MIRROR = np.array([1, 1, -1, 1])
ROTATION, QUATERNION = turn(raw(0, 400)["quat"]), raw(0, 400)["quat"]


def down(quaternion: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Gravity of other quaternions."""
    return lambda _: np.einsum("tij,i->tj", turn(quaternion), np.array([0, 0, -1.0]))


def smoothed(action: np.ndarray) -> np.ndarray:
    """Commands that were filtered."""
    made = action * SCALE + POSE
    for t in range(1, len(made)):
        made[t] = 0.3 * made[t] + 0.7 * made[t - 1]
    return made


def newest_last(frames: np.ndarray) -> np.ndarray:
    """Stack as described: whole frames, the oldest first."""
    return frames[:, ::-1].reshape(len(frames), -1)


def by_term(frames: np.ndarray) -> np.ndarray:
    """Stack each term's frames together."""
    parts = np.split(frames[:, ::-1], np.cumsum(SIZES)[:-1], axis=2)
    return np.concatenate([part.reshape(len(frames), -1) for part in parts], axis=1)


def check(tmp_path: Path, history: int = 1, keys: dict[str, Any] | None = None, **faults) -> Answer:
    """Walk with faults, and check the walk."""
    keys = {"history": {"length": history}, **(keys or {})}
    if history > 1:
        faults = {"stack": newest_last, "history": history, **faults}
    log, actor = walk(**faults)
    return check_contract([log], described(tmp_path / "OBS.yaml", **keys), actor)


# name: (what is broken, stage, fault, place, a word of the fix)
FAULTS: dict[str, tuple[dict[str, Any], str, str, str, str]] = {
    "order": (
        {"see": {"joint_position": lambda x: x[:, SWAP]}},
        "observation", "permutation", "joint_position", "[hip_r, knee_r, hip_l, knee_l]",
    ),
    "order of two": (
        {"see": {"joint_velocity": lambda x: x[:, [1, 0, 2, 3]]}},
        "observation", "permutation", "joint_velocity: hip_l, knee_l", "knee_l, hip_l, hip_r",
    ),
    "sign": (
        {"see": {"joint_position": lambda x: x * MIRROR}},
        "observation", "sign", "joint_position: hip_r", "negate hip_r",
    ),
    "degrees": ({"see": {"gyro": np.degrees}}, "observation", "unit", "gyro", "convert it to rad"),
    "no scale": (
        {"see": {"joint_velocity": lambda x: x / 0.05}},
        "observation", "scale", "joint_velocity", "multiply it by its scale",
    ),
    "scale twice": (
        {"see": {"gyro": lambda x: x * 0.25}},
        "observation", "scale", "gyro", "multiply it once",
    ),
    "scale": (
        {"see": {"joint_velocity": lambda x: x * 1.3}},
        "observation", "scale", "joint_velocity", "divide it by 1.3",
    ),
    "scale of one": (
        {"see": {"joint_velocity": lambda x: x * np.array([1, 1, 1.2, 1])}},
        "observation", "scale", "joint_velocity: hip_r", "divide it by 1.2",
    ),
    "pose": (
        {"see": {"joint_position": lambda x: x + POSE}},
        "observation", "default_pose", "joint_position", "take the default pose into account",
    ),
    "offset": (
        {"see": {"joint_position": lambda x: x + np.array([0, 0.1, 0, 0])}},
        "observation", "offset", "joint_position: knee_l", "zero",
    ),
    "gravity": (
        {"see": {"gravity": lambda x: -x}},
        "observation", "gravity_direction", "gravity", "negate it",
    ),
    "frame": (
        {"see": {"gyro": lambda x: np.einsum("tij,tj->ti", ROTATION, x)}},
        "observation", "frame", "gyro", "body's frame",
    ),
    "inverse": (
        {"see": {"gravity": down(QUATERNION * np.array([1, -1, -1, -1]))}},
        "observation", "frame", "gravity", "inverse rotation",
    ),
    "quaternion": (
        {"see": {"gravity": down(QUATERNION[:, [1, 2, 3, 0]])}},
        "observation", "quaternion_order", "gravity", "as xyzw",
    ),
    "age": ({"age": {"gyro": 1}}, "observation", "age", "gyro", "newest measurement"),
    "age of the action": (
        {"age": {"last_action": 1}},
        "observation", "age", "last_action", "newest measurement",
    ),
    "history's order": (
        {"history": 3, "stack": lambda f: f.reshape(len(f), -1)},
        "observation", "history_order", "history", "oldest first",
    ),
    "history's layout": (
        {"history": 3, "stack": by_term},
        "observation", "history_layout", "history", "frame after frame",
    ),
    "history's length": (
        {"history": 3, "stack": lambda f: np.repeat(f[:, :1], 3, 1).reshape(len(f), -1)},
        "observation", "history_length", "history", "one frame a control step",
    ),
    "slow policy": ({"every": 2}, "policy", "rate", "action", "every control step"),
    "action scale": (
        {"act": lambda a: np.clip(a, -3, 3) * 0.5 + POSE},
        "action", "scale", "ctrl", "divide it by 2",
    ),
    "action offset": (
        {"act": lambda a: np.clip(a, -3, 3) * SCALE},
        "action", "default_pose", "ctrl", "take the default pose into account",
    ),
    "action order": (
        {"act": lambda a: (a * SCALE + POSE)[:, SWAP]},
        "action", "permutation", "ctrl", "[hip_r, knee_r, hip_l, knee_l]",
    ),
    "action clipped": (
        {"act": lambda a: np.clip(a, -1, 1) * SCALE + POSE},
        "action", "clip", "ctrl", "clip the actions as described",
    ),
    "filter": ({"act": smoothed}, "action", "filter", "ctrl", "unfiltered"),
    "late command": (
        {"act": lambda a: older(a * SCALE + POSE, 1)},
        "action", "age", "ctrl", "newest measurement",
    ),
    "held command": (
        {"act": lambda a: (a * SCALE + POSE)[np.arange(len(a)) // 2 * 2]},
        "action", "rate", "ctrl", "every control step",
    ),
    "kp": ({"gains": (2 * KP, KD)}, "gains", "kp", "every joint", "set kp"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_with_its_place_and_fix(tmp_path, name):
    """One fault gives one finding, sure of it, and exit status 3."""
    broken, stage, fault, where, fix = FAULTS[name]
    answer = check(tmp_path, **broken)
    assert [(f.stage, f.fault, f.where) for f in answer.findings] == [(stage, fault, where)]
    assert fix in answer.findings[0].fix
    assert answer.findings[0].after < 0.05 < answer.findings[0].before
    assert answer.findings[0].sure in (None, 1.0)
    assert (answer.verdict, answer.exit_status) == ("broken", 3)


@pytest.mark.parametrize("seed", range(12))
def test_no_fault_gives_no_finding(tmp_path, seed):
    """Whatever the motion, and with noise of up to 3 % between the log and what the policy saw."""
    answer = check(tmp_path, seed=seed, noise=0.03 * (seed % 3) / 2, rows=200)
    assert answer.findings == ()
    assert (answer.verdict, answer.exit_status) == ("holds", 0)


def test_two_faults_are_named_both(tmp_path):
    """Two of one term, and one of another."""
    wrong = {"joint_position": lambda x: (x * MIRROR)[:, SWAP], "gyro": np.degrees}
    answer = check(tmp_path, see=wrong)
    named = {(f.fault, f.where) for f in answer.findings}
    assert named == {
        ("unit", "gyro"),
        ("permutation", "joint_position"),
        ("sign", "joint_position: hip_l"),
    }


def test_a_scrambled_term_is_unexplained_and_not_guessed(tmp_path):
    """Numbers that no fault makes are named as such; no fault is."""
    noise = np.random.default_rng(3).normal(size=(400, 3))
    answer = check(tmp_path, see={"gyro": lambda x: noise})
    assert [(f.fault, f.where) for f in answer.findings] == [("unexplained", "gyro")]


def test_another_policy_is_unexplained(tmp_path):
    """Actions that are not the policy's are told, and blamed on nothing else."""
    log, _ = walk()
    answer = check_contract([log], described(tmp_path / "OBS.yaml"), walk(seed=9)[1])
    assert [(f.stage, f.fault) for f in answer.findings] == [("policy", "unexplained")]


def test_what_a_mirrored_gait_cannot_tell_is_a_set(tmp_path):
    """Legs that move alike can be exchanged: a set without a fault, rivals with one."""
    angle = raw(0, 400)["joint_position"] - POSE
    angle[:, 2:] = angle[:, :2]
    mirrored = {"joint_position": angle + POSE}
    answer = check(tmp_path, sensed=mirrored)
    assert answer.findings == ()
    places = [one.where for one in answer.cannot_tell]
    assert "joint_position: hip_l, hip_r" in places
    assert "joint_position: knee_l, knee_r" in places
    swapped = check(tmp_path, sensed=mirrored, see={"joint_position": lambda x: x[:, [1, 0, 2, 3]]})
    assert [f.fault for f in swapped.findings] == ["permutation"]
    assert 1 <= len(swapped.findings[0].among) <= 2


def test_what_a_static_joint_cannot_tell_is_said(tmp_path):
    """A joint that never moved shows neither sign nor order."""
    angle = raw(0, 400)["joint_position"]
    angle[:, 1] = POSE[1]
    answer = check(tmp_path, sensed={"joint_position": angle})
    assert answer.findings == ()
    assert any(o.where == "joint_position: knee_l" and "did not move" in o.text
               for o in answer.cannot_tell)  # fmt: skip


def test_a_normalizer_inside_the_policy_that_was_applied_before(tmp_path):
    """Twice and not at all are told apart where the policy's file says the normalizer."""
    rng = np.random.default_rng(5)
    mean, std = rng.normal(0, 1, 20), rng.uniform(0.3, 3.0, 20)
    for fault, feed in (
        ("normalizer_twice", lambda o: (o - mean) / std),
        ("normalizer_missing", lambda o: o * std + mean),
    ):
        log, actor = walk(feed=feed)
        about = described(tmp_path / "OBS.yaml")
        answer = check_contract([log], about, actor, np.stack([mean, std]))
        assert [(f.stage, f.fault) for f in answer.findings] == [("policy", fault)]


@pytest.mark.parametrize(("times", "fault"), [(0, "normalizer_missing"), (2, "normalizer_twice")])
def test_a_described_normalizer(tmp_path, times, fault):
    """The log holds the vector after it; applied once is right."""
    rng = np.random.default_rng(5)
    mean, std = rng.normal(0, 1, 20), rng.uniform(0.3, 3.0, 20)
    keys = {"normalizer": {"mean": mean.tolist(), "std": std.tolist()}}

    def stack(count: int):
        def apply(frames: np.ndarray) -> np.ndarray:
            made = frames[:, 0]
            for _ in range(count):
                made = (made - mean) / std
            return made

        return apply

    assert check(tmp_path, keys=keys, stack=stack(1)).findings == ()
    answer = check(tmp_path, keys=keys, stack=stack(times))
    assert [f.fault for f in answer.findings] == [fault]


def without(log: Log, kind: str) -> Log:
    """Leave columns out."""
    kept = {n: v for n, v in log.columns.items() if not n.startswith(kind)}
    return Log(kept, log.meta)


def changed(log: Log, name: str, change: Callable[[np.ndarray], np.ndarray]) -> Log:
    """Change the columns of a kind."""
    columns = {n: change(v) if n.startswith(name) else v for n, v in log.columns.items()}
    return Log(columns, log.meta)


BAD: dict[str, tuple[Callable[[Log], Log], str]] = {
    "no actions": (lambda log: without(log, "action."), "the log has no actions"),
    "no gyro": (lambda log: without(log, "gyro."), "gyro needs the columns gyro.<site>"),
    "no channel": (lambda log: without(log, "sensor.vx"), "'sensor.vx'"),
    "sizes": (lambda log: without(log, "obs.19"), "gyro 3, gravity 3, command 2"),
    "quaternions": (lambda log: changed(log, "quat.", lambda v: 2 * v), "the length is 2"),
}


@pytest.mark.parametrize("what", BAD)
def test_logs_that_do_not_fit_are_refused(tmp_path, what):
    """One sentence with the place, before anything is compared."""
    change, words = BAD[what]
    log, actor = walk(rows=60)
    with pytest.raises(ContractError) as refused:
        check_contract([change(log)], described(tmp_path / "OBS.yaml"), actor)
    assert words in str(refused.value)


def test_an_accelerometer_in_g_or_in_free_fall_is_refused(tmp_path):
    """Gravity tells the unit."""
    keys = {"observation": [{"term": "accelerometer"}], "action": {"scale": SCALE}}
    log, _ = walk(rows=60)
    for size, words in ((1.0, "multiples of g"), (0.01, "about 9.81")):
        columns = {f"accelerometer.imu.{axis}": np.zeros(60) for axis in "xyz"}
        columns["accelerometer.imu.z"] += size
        seen = {f"obs.{i}": np.zeros(60) for i in range(3)}
        bare = without(log, "obs.")
        with pytest.raises(ContractError, match=words):
            check_contract(
                [Log({**bare.columns, **columns, **seen}, {})],
                described(tmp_path / "OBS.yaml", **keys),
            )


def test_what_is_not_logged_is_said(tmp_path):
    """Without observations and a policy only the commands are compared."""
    log, _ = walk()
    about = described(tmp_path / "OBS.yaml")
    answer = check_contract([without(log, "obs.")], about)
    assert answer.verdict == "holds"
    assert {"observation", "policy"} <= {one.where for one in answer.cannot_tell}
    wrong = changed(without(log, "obs."), "ctrl.", lambda v: -v)
    assert check_contract([wrong], about).verdict == "broken"


def test_a_log_at_another_rate(tmp_path):
    """Rows that come twice as often as the policy was trained to run."""
    log, actor = walk()
    fast = changed(log, "time", lambda v: v / 2)
    answer = check_contract([fast], described(tmp_path / "OBS.yaml"), actor)
    assert ("clock", "rate", "rows") in [(f.stage, f.fault, f.where) for f in answer.findings]


def test_computed_times_are_told(tmp_path):
    """What the preflight says of clocks is part of the answer."""
    log, actor = walk()
    nominal = Log(log.columns, {"clock": "nominal"})
    answer = check_contract([nominal], described(tmp_path / "OBS.yaml"), actor)
    assert [(f.stage, f.fault) for f in answer.findings] == [("clock", "clock")]


def test_the_answer_as_json(tmp_path):
    """contract.json holds all of it."""
    import json

    answer = check(tmp_path, see={"gyro": np.degrees})
    answer.write(tmp_path)
    facts = json.loads((tmp_path / "contract.json").read_text())
    assert (facts["schema"], facts["verdict"]) == (1, "broken")
    assert facts["findings"][0]["fault"] == "unit"
    assert facts["inputs"]["rows"] == 400
    assert set(JOINTS) == {k.split()[-1] for k in facts["checked"] if k.startswith("gains: kp")}
