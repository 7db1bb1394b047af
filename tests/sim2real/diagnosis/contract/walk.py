"""A synthetic walk with a known policy, and ways to break its interface.

    log, about, actor = walk(seed=1, see={"gyro": np.degrees})

Four joints swing with rhythms of their own, the body rolls, pitches and turns, and a fixed tanh
policy sees scaled terms. It is written by hand, and shares no code with what is tested.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hardware.log import Log
from sim2real.diagnosis.contract.description import Description, read_description

JOINTS = ("hip_l", "knee_l", "hip_r", "knee_r")
POSE = np.array([0.1, -0.8, 0.15, -0.9])
RATE, SCALE, KP, KD = 50.0, 0.25, 20.0, 0.5
GYRO_SCALE, SPEED_SCALE = 0.25, 0.05
ABOUT: dict[str, Any] = {
    "rate": RATE,
    "joints": list(JOINTS),
    "default_pose": POSE.tolist(),
    "observation": [
        {"term": "gyro", "scale": GYRO_SCALE},
        {"term": "gravity"},
        {"term": "command", "channels": ["sensor.vx", "sensor.yaw"]},
        {"term": "joint_position"},
        {"term": "joint_velocity", "scale": SPEED_SCALE},
        {"term": "last_action"},
    ],
    "action": {"scale": SCALE, "clip": 3.0, "kp": KP, "kd": KD},
}
TERMS = {"gyro": 3, "gravity": 3, "command": 2, "joint_position": 4, "joint_velocity": 4}
Change = Callable[[np.ndarray], np.ndarray]


def turn(q: np.ndarray) -> np.ndarray:
    """Rotation matrices (T, 3, 3) of quaternions w x y z."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def waves(rng: np.random.Generator, time: np.ndarray, count: int, size: float) -> np.ndarray:
    """Sums of three sines, no two alike, (T, count)."""
    rate = rng.uniform(0.5, 3.0, (3, count))
    phase = rng.uniform(0, 2 * np.pi, (3, count))
    part = rng.uniform(0.4, 1.0, (3, count)) * size
    return (part * np.sin(2 * np.pi * rate * time[:, None, None] + phase)).sum(1)


def older(x: np.ndarray, steps: int) -> np.ndarray:
    """Values of `steps` rows before; the first where there are none."""
    return np.concatenate([np.repeat(x[:1], steps, 0), x[: len(x) - steps]])


def raw(seed: int, rows: int) -> dict[str, np.ndarray]:
    """What the sensors measure."""
    rng, time = np.random.default_rng(seed), np.arange(rows) / RATE
    tilt = waves(rng, time, 2, 0.12)
    yaw = 0.9 * time + 0.3
    half = np.stack([tilt[:, 0], tilt[:, 1], yaw], 1) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half.T), np.sin(half.T)
    quat = np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        1,
    )
    angle = POSE + waves(rng, time, 4, 0.2)
    return {
        "time": time,
        "quat": quat,
        "gyro": waves(rng, time, 3, 0.6) + np.array([0, 0, 0.9]),
        "joint_position": angle,
        "joint_velocity": np.gradient(angle, time, axis=0),
        "command": 0.5 + waves(rng, time, 2, 0.3),
    }


def described(path: Path, **keys: Any) -> Description:
    """Read the walk's description, with other keys."""
    path.write_text(yaml.safe_dump({**ABOUT, **keys}))
    return read_description(path, JOINTS)


def walk(
    seed: int = 0,
    see: Mapping[str, Change] | None = None,
    age: Mapping[str, int] | None = None,
    feed: Change = lambda obs: obs,
    act: Change = lambda action: np.clip(action, -3.0, 3.0) * SCALE + POSE,
    stack: Change = lambda frames: frames[:, 0],
    history: int = 1,
    every: int = 1,
    gains: tuple[float, float] = (KP, KD),
    sensed: Mapping[str, np.ndarray] | None = None,
    noise: float = 0.0,
    rows: int = 400,
) -> tuple[Log, Callable[[np.ndarray], np.ndarray]]:
    """Walk, and return the log and the policy.

    Args:
        seed: of the motion and the policy.
        see: by term, what is done to its scaled numbers before the policy sees them.
        age: by term, by how many steps it is late.
        feed: what is done to the whole vector after it was logged.
        act: actions (T, 4) to commands (T, 4).
        stack: frames (T, H, F), the newest first, to vectors.
        history: H.
        every: rows between two runs of the policy.
        gains: kp and kd of the drives.
        sensed: measurements instead of those of the seed.
        noise: of the logged channels, of their spread.
        rows: T.
    """
    see, age = see or {}, age or {}
    m = {**raw(seed, rows), **(sensed or {})}
    scaled = {
        "gyro": m["gyro"] * GYRO_SCALE,
        "gravity": np.einsum("tij,i->tj", turn(m["quat"]), np.array([0, 0, -1.0])),
        "command": m["command"],
        "joint_position": m["joint_position"] - POSE,
        "joint_velocity": m["joint_velocity"] * SPEED_SCALE,
    }
    blocks = [older(see.get(n, lambda x: x)(scaled[n]), age.get(n, 0)) for n in TERMS]
    still = np.concatenate(blocks, axis=1)
    rng = np.random.default_rng([seed, 1])
    size = (still.shape[1] + 4) * history
    weight, bias = rng.normal(0, 1.6 / np.sqrt(size), (size, 4)), rng.normal(0, 0.2, 4)

    def actor(obs: np.ndarray) -> np.ndarray:
        return 2.0 * np.tanh(obs @ weight + bias)

    frames, seen, done = [], [], [np.zeros(4)]
    last_late = age.get("last_action", 0)
    for t in range(rows):
        last = done[max(len(done) - 1 - last_late, 0)]
        last = see.get("last_action", lambda x: x)(last[None])[0]
        frames.insert(0, np.concatenate([still[t], last]))
        past = [frames[min(h, len(frames) - 1)] for h in range(history)]
        seen.append(stack(np.array(past)[None]).reshape(-1))
        fresh = t % every == 0
        done.append(actor(feed(seen[-1][None]))[0] if fresh else done[-1])
    action, obs = np.array(done[1:]), np.array(seen)
    sent = act(action)
    torque = gains[0] * (older(sent, 1) - m["joint_position"]) - gains[1] * m["joint_velocity"]
    columns: dict[str, np.ndarray] = {"episode": np.zeros(rows), "time": m["time"]}
    names = {
        **{f"ctrl.{n}": sent[:, j] for j, n in enumerate(JOINTS)},
        **{f"qpos.{n}": m["joint_position"][:, j] for j, n in enumerate(JOINTS)},
        **{f"qvel.{n}": m["joint_velocity"][:, j] for j, n in enumerate(JOINTS)},
        **{f"sensor.torque_{n}": torque[:, j] for j, n in enumerate(JOINTS)},
        **{f"quat.imu.{p}": m["quat"][:, i] for i, p in enumerate("wxyz")},
        **{f"gyro.imu.{p}": m["gyro"][:, i] for i, p in enumerate("xyz")},
        "sensor.vx": m["command"][:, 0],
        "sensor.yaw": m["command"][:, 1],
    }
    shaken = np.random.default_rng([seed, 2])
    for name, values in names.items():
        loud = noise * values.std() * (not name.startswith(("ctrl", "quat")))
        columns[name] = values + loud * shaken.standard_normal(rows)
    columns |= {f"action.{i}": action[:, i] for i in range(4)}
    columns |= {f"obs.{i}": obs[:, i] for i in range(obs.shape[1])}
    return Log(columns, {}), actor
