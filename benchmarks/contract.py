"""Does `run=contract` name faults of a policy's interface that it is not told?

    python -m benchmarks.contract                       # 45 faulty and 45 sound walks: minutes
    python -m benchmarks.contract --cases 100 --seed 8
    python -m benchmarks.contract --robots quad12
    python -m benchmarks.contract --policies --cases 300        # trained by other libraries

A perceptron with random weights drives a simulated robot (quad8, hopper2, arm6, quad12) through
an interface with one or two faults, in closed loop; the check gets the log, the policy and the
ready-made description, never the key. With `--policies` it is a policy that another library
trained and exported as ONNX (`benchmarks/policies`), with its own OBS.yaml. A case is named if
every fault of the key is a finding, or stands beside one in a set of at most three, and there is no
other finding. A sound case is right if there is none. Intervals are exact binomial ones, 95 %.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.cases import share
from benchmarks.contract_walk import Change, Fault, Named, walk
from benchmarks.policies.tasks import POLICIES, arm
from benchmarks.study import at_least, command
from envs.tasks import Follow, Hopper2, Quad8, Quad12
from envs.tasks.servo import ServoTask
from sim2real.diagnosis.contract.answer import Answer
from sim2real.diagnosis.contract.check import check_contract
from sim2real.diagnosis.contract.description import Description, History, read_description
from sim2real.runs.tables import Table

ROBOTS = ("quad8", "hopper2", "arm6", "quad12")
TASKS: dict[str, Callable[..., ServoTask]] = {"quad8": Quad8, "hopper2": Hopper2, "quad12": Quad12}
SECONDS = 3.0  # of a walk
TWO = 0.4  # share of faulty cases with two faults


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, make and check the cases, and keep the table."""
    parser = command("contract", __doc__, "results")
    add = parser.add_argument
    add("--cases", type=at_least(1), default=45, help="faulty, and as many sound ones")
    add("--seed", type=int, default=7, help="of their draw (default: %(default)s)")
    add("--robots", nargs="+", choices=ROBOTS, default=ROBOTS, help="in turns")
    add("--policies", action="store_true", help="those of other libraries")
    chosen = parser.parse_args(arguments)
    make = foreign if chosen.policies else partial(case, robots=chosen.robots)
    cases = [make(chosen.seed, number, number < chosen.cases) for number in range(2 * chosen.cases)]
    made = table(cases)
    made.notes.append(f"{chosen.cases} faulty and as many sound walks of seed {chosen.seed}.")
    made.notes += missed(cases)
    made.write(chosen.results / ("contract_policies" if chosen.policies else "contract"))
    print(made.markdown())
    return 0


def case(seed: int, number: int, faulty: bool, robots: Sequence[str] = ROBOTS) -> dict[str, Any]:
    """Make a walk, check it, and open its key."""
    rng = np.random.default_rng([seed, number])
    robot = robots[number % len(robots)]
    task = task_of(robot)
    model = task.spec().compile()
    joints = [model.actuator(i).name for i in range(model.nu)]
    about = read_description("follow" if robot == "arm6" else robot, joints)
    faults = drawn(about, rng) if faulty else []
    actor = perceptron(about.size, task.action_range(model)[0], rng)
    return judged(robot, task, about, actor, faults, rng)


def foreign(seed: int, number: int, faulty: bool) -> dict[str, Any]:
    """Do the same with a policy of another library."""
    rng = np.random.default_rng([seed, number])
    policy = list(POLICIES.values())[number % len(POLICIES)]
    task = policy.task()
    model = task.spec().compile()
    about = policy.about([model.actuator(i).name for i in range(model.nu)])
    faults = drawn(about, rng) if faulty else []
    name = f"{policy.robot} ({policy.library})"
    return judged(name, task, about, policy.actor(), faults, rng)


def judged(
    robot: str,
    task: ServoTask,
    about: Description,
    actor: Change,
    faults: Sequence[Fault],
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Walk with faults, check the walk, and open its key."""
    log = walk(task, about, faults, actor, rng)
    answer = check_contract([log], about, actor)
    key = [fault.key for fault in faults]
    return {"robot": robot, "key": key, "named": named(answer, key), "found": told(answer)}


def perceptron(size: int, low: np.ndarray, rng: np.random.Generator) -> Change:
    """Return a policy with random weights."""
    weight = rng.normal(0, 1.5 / np.sqrt(size), (size, len(low)))

    def actor(seen: np.ndarray) -> np.ndarray:
        return np.abs(low) * np.tanh(seen @ weight)

    return actor


def task_of(robot: str) -> ServoTask:
    """Return the task of a robot; arm6, here with six small servos, follows sines."""
    if robot == "arm6":
        return arm(Follow, SECONDS)
    return TASKS[robot](seconds=SECONDS)


def drawn(about: Description, rng: np.random.Generator) -> list[Fault]:
    """Draw one or two faults at different places."""
    menu = [fault for term in about.terms for fault in of_term(term, rng, about)]
    menu += of_vector(about)
    menu += of_goals(about, rng)
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


def of_vector(about: Description) -> list[Fault]:
    """Return faults of the whole observation: how frames are stacked, and the normalizer."""
    found, own = [], about.history
    if own.length > 1:
        order = "oldest_first" if own.order == "newest_first" else "newest_first"
        layout = "term" if own.layout == "frame" else "frame"
        ways = {
            "history_order": History(own.length, own.layout, order),
            "history_layout": History(own.length, layout, own.order),
            "history_length": History(1, own.layout, own.order),  # the newest, repeated
        }
        found += [Fault(("observation", name, "history"), stack=way) for name, way in ways.items()]
    if about.normalizer is not None:
        for name, times in (("normalizer_missing", 0), ("normalizer_twice", 2)):
            found.append(Fault(("observation", name, "normalizer"), normalized=times))
    return found


def of_term(term: Any, rng: np.random.Generator, about: Description) -> list[Fault]:
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
    if name not in ("last_action", "gravity"):
        found.append(Fault(key("unit"), np.degrees))
    if name in ("roll_pitch", "gravity"):
        found.append(Fault(key("quaternion_order"), quaternion=True))
    if name == "gravity":
        found.append(Fault(key("gravity_direction"), lambda x: -x))
    if name in ("gravity", "gyro"):
        found.append(Fault(key("frame"), frame=True))
    if term.relative:
        added = term.scale * about.default_pose
        found.append(Fault(key("default_pose"), lambda x: x + added))
    return found


def of_goals(about: Description, rng: np.random.Generator) -> list[Fault]:
    """Return faults between the action and the servos."""
    names = list(about.actuators)
    n, law = len(names), about.action
    zero = law.offset if law.law == "joint_position" else np.zeros(n)  # what is not scaled
    a, b = (int(i) for i in rng.choice(n, 2, replace=False))
    like = np.flatnonzero(np.isclose(zero, zero[a]) & (np.arange(n) != a))
    if law.law == "joint_position" and len(like):  # a goal of another joint is beyond its limits
        b = int(rng.choice(like))
    order, shift = np.arange(n), np.zeros(n)
    order[[a, b]], shift[a] = [b, a], rng.choice([-1, 1]) * rng.uniform(0.05, 0.2)
    ratio, share = float(rng.uniform(0.5, 0.85)), float(rng.choice([0.3, 0.4, 0.5, 0.6]))
    pair = "ctrl" if n == 2 else f"ctrl: {', '.join(names[i] for i in sorted((a, b)))}"
    exchanged = [Fault(("action", "permutation", pair), lambda x: x[order])]
    if law.law == "joint_position" and not len(like):
        exchanged = []
    return [
        *exchanged,
        Fault(("action", "offset", f"ctrl: {names[a]}"), lambda x: x + shift),
        Fault(("action", "scale", "ctrl"), lambda x: zero + ratio * (x - zero)),
        Fault(("action", "age", "ctrl"), age=int(rng.integers(1, 3))),
        Fault(("action", "filter", "ctrl"), smoothing=share),
    ]


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
    for robot in sorted({c["robot"] for c in cases}, key=_place):
        _add(made, f"one fault, {robot}", [c for c in cases if c["robot"] == robot and _n(c) == 1])
        _add(made, f"two faults, {robot}", [c for c in cases if c["robot"] == robot and _n(c) > 1])
    _add(made, "all faulty", [c for c in cases if _n(c)])
    _add(made, "sound", [c for c in cases if not _n(c)])
    return made


def _place(robot: str) -> tuple[int, str]:
    """Return where a robot stands in the table."""
    return next(i for i, name in enumerate(ROBOTS) if robot.startswith(name)), robot


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
        made.add(what, len(cases), share([one["named"] for one in cases]))


if __name__ == "__main__":
    raise SystemExit(main())
