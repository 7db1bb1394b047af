"""Walks of a simulated robot through a policy's interface with faults, for `benchmarks.contract`.

    log = walk(task, about, [Fault(("observation", "age", "gyro"), age=2)], actor, rng)

The faults act in closed loop. They are made here from the simulation's state, by no code of the
check's own.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.policies.tasks import down
from envs.simulation import Simulation
from envs.tasks.servo import ServoTask
from envs.tasks.servo.base import commanded
from envs.tasks.servo.drive import COUNT
from envs.tasks.servo.legs import roll_pitch
from hardware.log import Log
from sim2real.diagnosis.contract.description import Description, History

Change = Callable[[np.ndarray], np.ndarray]
Named = tuple[str, str, str]  # stage, fault, where


class Fault(NamedTuple):
    """One hidden fault: what it is called, and what it does to the rows of a term or of goals."""

    key: Named
    change: Change | None = None  # of a term's numbers (k,), or of goals (n,)
    age: int = 0  # steps
    every: int = 1  # rows between two runs of the policy
    smoothing: float = 1.0
    quaternion: bool = False  # read in the other order
    frame: bool = False  # a vector in the world's axes, or gravity turned the wrong way
    stack: History | None = None  # how frames are stacked
    normalized: int = 1  # times


def walk(
    task: ServoTask,
    about: Description,
    faults: Sequence[Fault],
    actor: Change,
    rng: np.random.Generator,
) -> Log:
    """Walk with faults in closed loop; return the log."""
    goals, made = _break(task, about, faults)
    rows = Simulation(task, 1, threads=1)
    rows.reset(np.arange(1), np.zeros((1, 0)), rng.integers(1 << 32, size=1).astype(np.uint64))
    every = max([fault.every for fault in faults], default=1)
    kinds = {term.kind for term in about.terms}
    table: list[dict[str, float]] = []
    past: list[np.ndarray] = []
    frames: list[np.ndarray] = []
    action = np.zeros(rows.action_size)
    for t in range(task.max_steps):
        state = rows.state()
        past.append(seen_by(task, about, state, faults))
        frames.append(aged(about, faults, past))
        seen = stacked(about, faults, frames)
        if t % every == 0:
            action = actor(seen[None])[0]
        angle, speed = state.qpos[0, task.q], state.qvel[0, task.v]
        row = {"episode": 0.0, "time": t * task.dt}
        row |= {f"qpos.{n}": float(x) for n, x in zip(about.joints, angle, strict=True)}
        row |= {f"qvel.{n}": float(x) for n, x in zip(about.joints, speed, strict=True)}
        if kinds & {"roll_pitch", "gravity"}:
            row |= {f"quat.imu.{p}": float(x) for p, x in zip("wxyz", state.qpos[0, 3:7])}  # noqa: B905
        if "gyro" in kinds:
            row |= {f"gyro.imu.{p}": float(x) for p, x in zip("xyz", state.qvel[0, 3:6])}  # noqa: B905
        row |= {f"obs.{i}": float(x) for i, x in enumerate(seen)}
        row |= {f"action.{i}": float(x) for i, x in enumerate(action)}
        step = rows.step(None, action[None])
        sent = commanded(rows.state()).goal[0]
        if about.action.law == "joint_position":  # as a guard that limits the goals tells
            row["flag.limited"] = float(np.abs(sent - made[-1]).max() > COUNT)
        row |= {f"action.{n}": float(x) for n, x in zip(about.actuators, goals[-1], strict=True)}
        row |= {f"ctrl.{n}": float(x) for n, x in zip(about.actuators, sent, strict=True)}
        table.append(row)
        if step.failed[0]:
            break
    return Log({name: np.array([row[name] for row in table]) for name in table[0]})


def _break(
    task: ServoTask, about: Description, faults: Sequence[Fault]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Put faults between the action and the servos; return the goals, and what becomes of them.

    Where the law is the policy's own, they act before the robot's limits, else on what the task
    sends.
    """
    name = "target_angles" if about.action.law == "joint_position" else "command"
    right, goals, made = getattr(task, name), list[np.ndarray](), list[np.ndarray]()
    acting = [fault for fault in faults if fault.key[0] == "action"]

    def broken(state: Any, action: np.ndarray) -> np.ndarray:
        goals.append(right(state, action)[0])
        now = goals[-1]
        for fault in acting:
            now = goals[max(len(goals) - 1 - fault.age, 0)] if fault.age else now
            now = fault.change(now) if fault.change else now
            last = made[-1] if made else now
            now = fault.smoothing * now + (1 - fault.smoothing) * last
        made.append(now)
        return now[None]

    setattr(task, name, broken)
    return goals, made


def seen_by(task: ServoTask, about: Description, state: Any, faults: Sequence[Fault]) -> np.ndarray:
    """Return a frame of what a policy sees now, before anything is late."""
    seen, start = task.observe(state)[0].copy(), 0
    for term in about.terms:
        part = slice(start, start + term.size)
        start += term.size
        for fault in faults:
            if fault.key[0] != "observation" or fault.key[2].split(":")[0] != term.kind:
                continue
            if fault.quaternion:
                see = roll_pitch if term.kind == "roll_pitch" else down
                seen[part] = see(state.qpos[:, [4, 5, 6, 3]])[0]
            if fault.frame:
                seen[part] = turned(term, state)
            seen[part] = fault.change(seen[part]) if fault.change else seen[part]
    return seen


def turned(term: Any, state: Any) -> np.ndarray:
    """Return a gyro's rates in the world's axes, or gravity turned by the inverse rotation."""
    turn = Rotation.from_quat(state.qpos[0, 3:7], scalar_first=True)
    vector = [0.0, 0.0, -1.0] if term.kind == "gravity" else state.qvel[0, 3:6]
    return term.scale * turn.apply(vector)


def aged(about: Description, faults: Sequence[Fault], past: Sequence[np.ndarray]) -> np.ndarray:
    """Return the newest frame with the terms late that a fault makes late."""
    seen, start = past[-1].copy(), 0
    for term in about.terms:
        part = slice(start, start + term.size)
        start += term.size
        for fault in faults:
            if fault.key[0] == "observation" and fault.key[2].split(":")[0] == term.kind:
                seen[part] = past[max(len(past) - 1 - fault.age, 0)][part]
    return seen


def stacked(
    about: Description, faults: Sequence[Fault], frames: Sequence[np.ndarray]
) -> np.ndarray:
    """Return the whole vector: frames stacked and normalized as the faults have it."""
    own = next((fault.stack for fault in faults if fault.stack), about.history)
    depth = about.history.length
    back = [0 if own.length < depth else h for h in range(depth)]
    chosen = [frames[max(len(frames) - 1 - h, 0)] for h in back]  # the newest first
    chosen = chosen if own.order == "newest_first" else chosen[::-1]
    if own.layout == "term":
        cuts = np.cumsum([term.size for term in about.terms])[:-1]
        parts = zip(*(np.split(frame, cuts) for frame in chosen), strict=True)
        seen = np.concatenate([number for part in parts for number in part])
    else:
        seen = np.concatenate(chosen)
    if about.normalizer is not None:
        mean, std = about.normalizer
        for _ in range(next((f.normalized for f in faults if f.normalized != 1), 1)):
            seen = (seen - mean) / std
    return seen
