"""Does a cause cost the policy on the robot what `worth` says?

    python -m benchmarks.worth --robots 40              # goes on where it stopped
    python -m benchmarks.worth --robots 12 --seed 4

An emulated robot (servo emulator, bus, another time step than the model's) hides two to four
effects; a policy that was trained in its simulator as given walks or hops on it. Predicted:
`compute_cause_costs` of the hidden effects, what putting right each alone would bring (`last`).
Measured: the same episodes (starts) on the robot with all of them, and with each removed in turn.
A row a cost in `worth.csv`; a robot that is there is not run again. Policies are those of
`benchmarks.improve`, and are trained where they are missing (minutes each).
"""

import logging
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks.cases import DRAWS, Cases, over_runs, share
from benchmarks.improve import Case, trained
from benchmarks.study import RUNS, at_least, command
from envs.effects import make
from hardware.backends import ServoBackend
from hardware.config import Robot, load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.safety import StopLimits
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.robot_env import on_robot, play, robot_of
from sim2real.deployment.trained import load_policy
from sim2real.evaluation.cause_costs import Cause, CoalitionRollouts, compute_cause_costs
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

ROBOTS = ("quad8", "hopper2")
POLICIES = 2  # trained with as many seeds
EPISODES = {"quad8": 12, "hopper2": 32}  # on each robot: the hopper falls now and then
ROLLOUTS = 64  # of each subset, in simulation
SETTLE = 1.0  # s that the start is held
STOPS = StopLimits(odd_voltage=1.0, stray=2.0)  # a hidden effect must not stop the robot
Entry = dict[str, Any]
FIELDS: tuple[str, ...] = ("case", "robot", "policy", "effect", "where", "value", "predicted")
FIELDS += ("predicted_low", "predicted_high", "measured", "measured_low", "measured_high")
FIELDS += ("simulator_as_given", "simulator", "robot_return")
# of each effect: smallest and largest value, by robot; None: one for the whole robot
SIZES: dict[str, dict[str, tuple[float, float]]] = {
    "coulomb_friction": {"quad8": (0.02, 0.1), "hopper2": (0.005, 0.03)},
    "viscous_friction": {"quad8": (0.02, 0.12), "hopper2": (0.001, 0.006)},
    "position_gain": {"quad8": (0.4, 0.8), "hopper2": (0.5, 0.9)},
    "supply_voltage": {"quad8": (0.75, 0.92), "hopper2": (0.75, 0.95)},
    "command_delay": {"quad8": (0.01, 0.04), "hopper2": (0.004, 0.015)},
    "ground_friction": {"quad8": (0.2, 0.6), "hopper2": (0.2, 0.6)},
    "link_mass": {"quad8": (0.1, 0.5), "hopper2": (0.01, 0.04)},
    "motor_strength": {"quad8": (0.4, 0.8), "hopper2": (0.6, 0.9)},
    "encoder_offset": {"quad8": (0.05, 0.15), "hopper2": (0.03, 0.1)},
}
BODY = {"quad8": "torso", "hopper2": "body"}


def drawn(robot: Robot, rng: np.random.Generator) -> list[Entry]:
    """Draw two to four effects that a robot hides, each kind once."""
    kinds = rng.choice(sorted(SIZES), int(rng.integers(2, 5)), replace=False)
    found = []
    for kind in map(str, kinds):
        value = float(rng.uniform(*SIZES[kind][robot.name]))
        where = None
        if kind == "link_mass":
            where = BODY[robot.name]
        if kind in ("motor_strength", "encoder_offset"):
            where = str(rng.choice(list(robot.names)))
        sign = float(rng.choice([-1.0, 1.0])) if kind == "encoder_offset" else 1.0
        found.append({"effect": kind, "where": where, "value": sign * value})
    return found


def earned(
    policy: TrainedPolicy, robot: Robot, hidden: Sequence[Entry], seeds: np.ndarray, noise: int
) -> np.ndarray | None:
    """Return what a policy earns on an emulated robot, (E,); None if its guard stopped it."""
    world = EmulatedRobot(robot, hidden=make_hidden(list(hidden), robot), seed=noise)
    backend = ServoBackend(robot, SETTLE, world, limits=STOPS, seed=noise)
    env = on_robot(policy, servo_task(policy.environment), backend)
    rows = robot_of(env)
    returns = []
    try:
        rows.arm()
        actor = policy.acting(env)
        for seed in seeds:
            returns.append(play(env, actor, int(seed))[0])
            if rows.stopped is not None:
                return None
    finally:
        env.close()
    return np.array(returns)


def case(seed: int, number: int, policies: Path) -> list[dict[str, Any]]:
    """Price what a robot hides, remove each effect in turn, and return a row for each.

    A robot whose guard stops it is drawn again.
    """
    name, own = ROBOTS[number % len(ROBOTS)], number // len(ROBOTS) % POLICIES
    given = Case(name, "", own, policies)
    if not trained(given):
        raise SystemExit(f"{given.policy}: the policy's training failed")
    policy, robot = load_policy(given.policy), load_robot(name)
    rng = np.random.default_rng([seed, number])
    while True:
        hidden, noise = drawn(robot, rng), int(rng.integers(1 << 31))
        causes = [Cause(make(e["effect"], where=e["where"]), (e["value"],)) for e in hidden]
        seeds = CoalitionRollouts(policy, causes, EPISODES[name], number).seeds
        returns = [earned(policy, robot, hidden, seeds, noise)]
        for k in range(len(hidden)):
            left = [*hidden[:k], *hidden[k + 1 :]]
            returns.append(earned(policy, robot, left, seeds, noise))
        if all(one is not None for one in returns):
            break
    every, *without = [np.asarray(one) for one in returns]
    worth = compute_cause_costs(policy, causes, ROLLOUTS, seed=number)
    rows = []
    for entry, predicted, better in zip(hidden, worth.last["return"], without, strict=True):
        measured = over_runs(better - every)
        assert isinstance(measured, Interval)
        row = {"case": f"{seed}-{number}", "robot": name, "policy": f"seed{own}"}
        row |= {**entry, "where": entry["where"] or "robot", "value": f"{entry['value']:.4g}"}
        for what, told in (("predicted", predicted), ("measured", measured)):
            row |= {what: told.value, f"{what}_low": told.low, f"{what}_high": told.high}
        row["simulator_as_given"] = worth.plain["return"].value
        row["simulator"] = worth.every["return"].value
        row["robot_return"] = float(every.mean())
        rows.append({k: f"{v:.4f}" if isinstance(v, float) else v for k, v in row.items()})
    return rows


def score(rows: Sequence[Mapping[str, str]]) -> Table:
    """Return how often the sign is right, and how predicted and measured costs go together."""
    table = Table(("robots", "count", "costs", "beyond noise", "sign right", "rank correlation"))
    for name in ("all", *ROBOTS):
        own = [row for row in rows if name in ("all", row["robot"])]
        if not own:
            continue
        sure = [r for r in own if float(r["measured_low"]) > 0 or float(r["measured_high"]) < 0]
        right = [float(r["predicted"]) * float(r["measured"]) > 0 for r in sure]
        cases = sorted({row["case"] for row in own})
        part = share(right) if sure else None
        table.add(name, len(cases), len(own), len(sure), part, correlation(own, cases))
    return table


def correlation(rows: Sequence[Mapping[str, str]], cases: Sequence[str]) -> Interval | None:
    """Return Spearman's, with a 95 % interval of a bootstrap over robots."""
    costs = {
        name: np.array(
            [[float(r["predicted"]), float(r["measured"])] for r in rows if r["case"] == name]
        )
        for name in cases
    }
    if len(cases) < 2:
        return None

    def of(names: Sequence[str]) -> float:
        both = np.concatenate([costs[name] for name in names])
        told: Any = spearmanr(both[:, 0], both[:, 1])  # SciPy makes its type as it runs
        return float(told.statistic)

    rng = np.random.default_rng(0)
    draws = [of(rng.choice(cases, len(cases)).tolist()) for _ in range(DRAWS // 25)]
    return Interval(of(cases), *map(float, np.nanquantile(draws, [0.025, 0.975])))


def keep(own: Sequence[Mapping[str, Any]], seed: int, results: Path) -> str:
    """Write worth.md of a seed's rows, and return it."""
    table = score(own)
    episodes = ", ".join(f"{count} on {name}" for name, count in EPISODES.items())
    table.notes.append(
        f"`python -m benchmarks.worth --robots {len({r['case'] for r in own})} --seed {seed}`: a "
        "cost is what putting right one effect alone brings; predicted in "
        f"simulation ({ROLLOUTS} episodes), measured on the emulated robot ({episodes}). Beyond "
        "noise: the measured 95 % interval excludes 0. Intervals: exact binomial, and a bootstrap "
        "over robots."
    )
    write_text(results / "worth.md", table.markdown())
    return table.markdown()


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, run the robots that are missing, and tell the score."""
    parser = command("worth", __doc__, "results")
    add = parser.add_argument
    add("--robots", type=at_least(1), default=40, help="robots in all (default: 40)")
    add("--seed", type=at_least(0), default=3, help="of their draw (default: %(default)s)")
    policies = RUNS / "improve"
    add("--policies", type=Path, default=policies, help="folder of benchmarks.improve's policies")
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cases = Cases(chosen.results / "worth.csv", FIELDS)
    judged = partial(case, chosen.seed, policies=chosen.policies.resolve())
    print(keep(cases.run(chosen.seed, chosen.robots, judged), chosen.seed, chosen.results))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
