"""Does `run=contract` name faults of a policy's interface that it is not told?

    python -m benchmarks.contract                       # 45 faulty and 45 sound walks: minutes
    python -m benchmarks.contract --cases 100 --seed 8

A perceptron with random weights drives a simulated robot (quad8, hopper2, arm6) through an
interface with one or two faults, in closed loop; the check gets the log, the policy and the
ready-made description, never the key. A case is named if every fault of the key is a finding, or
stands beside one in a set of at most three, and there is no other finding. A sound case is right if
there is none. Intervals are exact binomial ones, 95 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from scipy.stats import binomtest

from envs.simulation import Simulation
from envs.tasks import Follow, Hopper2, Quad8
from envs.tasks.servo import ServoTask
from envs.tasks.servo.legs import roll_pitch
from hardware.log import Log
from sim2real.diagnosis.contract.answer import Answer
from sim2real.diagnosis.contract.check import check_contract
from sim2real.diagnosis.contract.description import Description, read_description
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
ROBOTS = ("quad8", "hopper2", "arm6")
ARM, SERVO = Path(__file__).parents[1] / "conf/robot/arm6.yaml", "xl430-w250"
SECONDS = 3.0  # of a walk
TWO = 0.4  # share of faulty cases with two faults
Change = Callable[[np.ndarray], np.ndarray]
Named = tuple[str, str, str]  # stage, fault, where


class Fault(NamedTuple):
    """One hidden fault: what it is called, and what it does to the rows of a term or of goals."""

    key: Named
    change: Change | None = None  # of a term's numbers (k,), or of goals (n,)
    age: int = 0  # steps
    every: int = 1  # rows between two runs of the policy
    smoothing: float = 1.0
    quaternion: bool = False


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, make and check the cases, and keep the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.contract",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cases", type=int, default=45, help="faulty, and as many sound ones")
    parser.add_argument("--seed", type=int, default=7, help="of their draw (default: %(default)s)")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the table")
    chosen = parser.parse_args(arguments)
    if chosen.cases < 1:
        parser.error("--cases must be at least 1")
    cases = [case(chosen.seed, number, number < chosen.cases) for number in range(2 * chosen.cases)]
    made = table(cases)
    made.notes.append(f"{chosen.cases} faulty and as many sound walks of seed {chosen.seed}.")
    made.notes += missed(cases)
    made.write(chosen.results / "contract")
    print(made.markdown())
    return 0


def case(seed: int, number: int, faulty: bool) -> dict[str, Any]:
    """Make a walk, check it, and open its key."""
    rng = np.random.default_rng([seed, number])
    robot = ROBOTS[number % len(ROBOTS)]
    task = task_of(robot)
    model = task.spec().compile()
    joints = [model.actuator(i).name for i in range(model.nu)]
    about = read_description("follow" if robot == "arm6" else robot, joints)
    faults = drawn(about, rng) if faulty else []
    log, actor = walk(task, about, faults, rng)
    answer = check_contract([log], about, actor)
    key = [fault.key for fault in faults]
    return {"robot": robot, "key": key, "named": named(answer, key), "found": told(answer)}


def task_of(robot: str) -> ServoTask:
    """Return the task of a robot; arm6, here with six small servos, follows sines."""
    if robot == "arm6":
        arm = yaml.safe_load(ARM.read_text(encoding="utf-8"))
        arm["servos"] = {n: {**one, "model": SERVO} for n, one in arm["servos"].items()}
        return Follow(robot=arm, model="arm6.xml", seconds=SECONDS)
    return (Quad8 if robot == "quad8" else Hopper2)(seconds=SECONDS)


def drawn(about: Description, rng: np.random.Generator) -> list[Fault]:
    """Draw one or two faults at different places."""
    menu = [fault for term in about.terms for fault in of_term(term, rng)]
    menu += of_goals(list(about.actuators), rng)
    menu.append(Fault(("policy", "rate", "action"), every=int(rng.integers(2, 4))))
    found: list[Fault] = []
    for _ in range(1 + (rng.random() < TWO)):
        taken = {fault.key[2].split(":")[0] for fault in found}
        left = [fault for fault in menu if fault.key[2].split(":")[0] not in taken]
        kinds = sorted({fault.key[:2] for fault in left})
        kind = kinds[rng.integers(len(kinds))]
        same = [fault for fault in left if fault.key[:2] == kind]
        found.append(same[rng.integers(len(same))])
    return found


def of_term(term: Any, rng: np.random.Generator) -> list[Fault]:
    """Return faults of one term of the observation."""
    name, parts, k = term.kind, term.elements, term.size
    if not term.rebuilt or name == "phase":
        return []

    def key(fault: str, *places: int) -> Named:
        at = f": {', '.join(parts[i] for i in sorted(places))}" if 0 < len(places) < k else ""
        return "observation", fault, f"{name}{at}"

    a, b = (int(i) for i in rng.choice(k, 2, replace=False))
    order, sign, shift = np.arange(k), np.ones(k), np.zeros(k)
    order[[a, b]], sign[a], shift[a] = [b, a], -1.0, rng.choice([-1, 1]) * rng.uniform(0.05, 0.3)
    ratio, age = float(rng.uniform(1.2, 3.0)), int(rng.integers(1, 4))
    found = [
        Fault(key("permutation", a, b), lambda x: x[order]),
        Fault(key("sign", a), lambda x: x * sign),
        Fault(key("scale"), lambda x: x * ratio),
        Fault(key("age"), age=age),
    ]
    if name in ("joint_position", "roll_pitch"):
        found.append(Fault(key("offset", a), lambda x: x + shift))
    if name != "last_action":
        found.append(Fault(key("unit"), np.degrees))
    if name == "roll_pitch":
        found.append(Fault(key("quaternion_order"), quaternion=True))
    return found


def of_goals(names: list[str], rng: np.random.Generator) -> list[Fault]:
    """Return faults between the action and the servos."""
    n = len(names)
    a, b = (int(i) for i in rng.choice(n, 2, replace=False))
    order, shift = np.arange(n), np.zeros(n)
    order[[a, b]], shift[a] = [b, a], rng.choice([-1, 1]) * rng.uniform(0.05, 0.2)
    ratio, share = float(rng.uniform(0.5, 0.85)), float(rng.choice([0.3, 0.4, 0.5, 0.6]))
    pair = "ctrl" if n == 2 else f"ctrl: {', '.join(names[i] for i in sorted((a, b)))}"
    return [
        Fault(("action", "permutation", pair), lambda x: x[order]),
        Fault(("action", "offset", f"ctrl: {names[a]}"), lambda x: x + shift),
        Fault(("action", "scale", "ctrl"), lambda x: x * ratio),
        Fault(("action", "age", "ctrl"), age=int(rng.integers(1, 3))),
        Fault(("action", "filter", "ctrl"), smoothing=share),
    ]


def walk(
    task: ServoTask, about: Description, faults: Sequence[Fault], rng: np.random.Generator
) -> tuple[Log, Change]:
    """Walk with faults in closed loop; return the log and the policy."""
    size, low = about.size, task.action_range(task.spec().compile())[0]
    weight = rng.normal(0, 1.5 / np.sqrt(size), (size, len(low)))

    def actor(seen: np.ndarray) -> np.ndarray:
        return np.abs(low) * np.tanh(seen @ weight)

    command, goals, sent = task.command, list[np.ndarray](), list[np.ndarray]()
    acting = [fault for fault in faults if fault.key[0] == "action"]

    def broken(state: Any, action: np.ndarray) -> np.ndarray:
        goals.append(command(state, action)[0])
        made = goals[-1]
        for fault in acting:
            made = goals[max(len(goals) - 1 - fault.age, 0)] if fault.age else made
            made = fault.change(made) if fault.change else made
            last = sent[-1] if sent else made
            made = fault.smoothing * made + (1 - fault.smoothing) * last
        sent.append(made)
        return made[None]

    task.command = broken  # type: ignore[method-assign]
    rows = Simulation(task, 1, threads=1)
    rows.reset(np.arange(1), np.zeros((1, 0)), rng.integers(1 << 32, size=1).astype(np.uint64))
    every = max([fault.every for fault in faults], default=1)
    table: list[dict[str, float]] = []
    past: list[np.ndarray] = []
    action = np.zeros(len(low))
    for t in range(task.max_steps):
        state = rows.state()
        past.append(seen_by(task, about, state, faults, past))
        seen = aged(about, faults, past)
        if t % every == 0:
            action = actor(seen[None])[0]
        angle, speed = state.qpos[0, task.q], state.qvel[0, task.v]
        row = {"episode": 0.0, "time": t * task.dt}
        row |= {f"qpos.{n}": float(x) for n, x in zip(about.joints, angle, strict=True)}
        row |= {f"qvel.{n}": float(x) for n, x in zip(about.joints, speed, strict=True)}
        if any(term.kind == "roll_pitch" for term in about.terms):
            row |= {f"quat.imu.{p}": float(x) for p, x in zip("wxyz", state.qpos[0, 3:7])}  # noqa: B905
        row |= {f"obs.{i}": float(x) for i, x in enumerate(seen)}
        row |= {f"action.{i}": float(x) for i, x in enumerate(action)}
        rows.step(None, action[None])
        row |= {f"action.{n}": float(x) for n, x in zip(about.actuators, goals[-1], strict=True)}
        row |= {f"ctrl.{n}": float(x) for n, x in zip(about.actuators, sent[-1], strict=True)}
        table.append(row)
    return Log({name: np.array([row[name] for row in table]) for name in table[0]}), actor


def seen_by(
    task: ServoTask,
    about: Description,
    state: Any,
    faults: Sequence[Fault],
    past: Sequence[np.ndarray],
) -> np.ndarray:
    """Return what a policy sees now, before anything is late."""
    seen, start = task.observe(state)[0].copy(), 0
    for term in about.terms:
        part = slice(start, start + term.size)
        start += term.size
        for fault in faults:
            if fault.key[0] != "observation" or fault.key[2].split(":")[0] != term.kind:
                continue
            if fault.quaternion:
                seen[part] = roll_pitch(state.qpos[:, [4, 5, 6, 3]])[0]
            seen[part] = fault.change(seen[part]) if fault.change else seen[part]
    return seen


def aged(about: Description, faults: Sequence[Fault], past: Sequence[np.ndarray]) -> np.ndarray:
    """Return the newest observation with the terms late that a fault makes late."""
    seen, start = past[-1].copy(), 0
    for term in about.terms:
        part = slice(start, start + term.size)
        start += term.size
        for fault in faults:
            if fault.key[0] == "observation" and fault.key[2].split(":")[0] == term.kind:
                seen[part] = past[max(len(past) - 1 - fault.age, 0)][part]
    return seen


def told(answer: Answer) -> list[Named]:
    """Return stage, fault and place of every finding."""
    return [(one.stage, one.fault, one.where) for one in answer.findings]


def named(answer: Answer, key: Sequence[Named]) -> bool:
    """Return whether the findings are the hidden faults, or sets that hold them, and no others."""
    left = list(key)
    for one in answer.findings:
        members = [(one.stage, one.fault, one.where)]
        members += [(one.stage, rival.fault, rival.where) for rival in one.among]
        hit = next((fault for fault in left if fault in members), None)
        if hit is None:
            return False
        left.remove(hit)
    return not left


def table(cases: Sequence[dict[str, Any]]) -> Table:
    """Return how many faults were named, by robot, and how many sound walks had a finding."""
    made = Table(("walks", "count", "right"))
    for robot in ROBOTS:
        _add(made, f"one fault, {robot}", [c for c in cases if c["robot"] == robot and _n(c) == 1])
        _add(made, f"two faults, {robot}", [c for c in cases if c["robot"] == robot and _n(c) > 1])
    _add(made, "all faulty", [c for c in cases if _n(c)])
    _add(made, "sound", [c for c in cases if not _n(c)])
    return made


def missed(cases: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for each case that was not right."""
    return [
        f"Missed, {c['robot']}: hidden {_words(c['key'])}; found {_words(c['found'])}."
        for c in cases
        if not c["named"]
    ]


def _n(one: dict[str, Any]) -> int:
    return len(one["key"])


def _words(faults: Sequence[Named]) -> str:
    return ", ".join(f"{fault} of {where} ({stage})" for stage, fault, where in faults) or "nothing"


def _add(made: Table, what: str, cases: Sequence[dict[str, Any]]) -> None:
    if cases:
        right = sum(one["named"] for one in cases)
        low, high = binomtest(right, len(cases)).proportion_ci(0.95)
        made.add(what, len(cases), Interval(right / len(cases), float(low), float(high)))


if __name__ == "__main__":
    raise SystemExit(main())
