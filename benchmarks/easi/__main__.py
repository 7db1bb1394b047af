"""EASI's study: identification from rollouts against uniform randomization, oracle and baselines.

    python -m benchmarks.easi                                    # cartpole, 5 seeds
    python -m benchmarks.easi --rows udr oracle easi_200 --seeds 0 1 2
    python -m benchmarks.easi --target far --rows udr oracle easi_200
    python -m benchmarks.easi --task quad8 --rows udr oracle easi_200
    python -m benchmarks.easi --report                           # the tables of what there is

For each seed: a policy under uniform randomization (by SAC; ant and ball_balance by PPO), its
demonstrations on the target, EASI, and a policy under what it found; beside it the target itself,
EASI's mean alone, and EASI's final width about the prior's mean. With --target all of that is done
for another robot (conf/shift), of which uniform randomization knows nothing: its policy is the
same, and EASI looks twice as far.
Each run has a folder of its own: what is complete is skipped, what was interrupted is continued.
Several of these programs may run at once and share the work.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks.easi import quad8, quad8_report, steps
from benchmarks.easi.plan import ROWS, STUDIES, Plan, targets
from benchmarks.easi.report import report
from benchmarks.study import command


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command("easi", __doc__, "out", "results")
    add = parser.add_argument
    add("--task", default="cartpole", choices=STUDIES, help="default: cartpole")
    add("--target", help="another target of the task: NAME of conf/shift/TASK_NAME.yaml")
    add("--rows", nargs="+", choices=ROWS, metavar="ROW", help=f"default: all of {', '.join(ROWS)}")
    add("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4], help="training seeds")
    add("--frames", type=int, help="environment steps of every training; default: the task's")
    add("--report", action="store_true", help="run nothing, write the tables")
    add("--set", nargs="*", default=[], metavar="KEY=VALUE", help="settings of every training")
    add("--identify", nargs="*", default=[], metavar="KEY=VALUE", help="and of every EASI run")
    chosen = parser.parse_args(arguments)
    plan = plan_of(parser, chosen)
    if chosen.task == "quad8":
        failed = 0 if chosen.report else quad8.run(plan)
        quad8_report.report(plan)
        return int(failed > 0)
    failed = 0 if chosen.report else steps.run(plan)
    report(plan)
    return int(failed > 0)


def plan_of(parser: argparse.ArgumentParser, chosen: argparse.Namespace) -> Plan:
    """Return what was asked for; what cannot be ends the program with a sentence."""
    if min(chosen.seeds) < 0 or (chosen.frames or 1) < 1:
        parser.error("--seeds must not be negative and --frames at least 1")
    if chosen.target is not None and chosen.target not in (known := targets(chosen.task)):
        there = ", ".join(known) or "none"
        parser.error(f"--target {chosen.target}: {chosen.task} has no such target; it has: {there}")
    rows: Sequence[str] = quad8.ROWS if chosen.task == "quad8" else list(ROWS)
    if foreign := [name for name in chosen.rows or () if name not in rows]:
        parser.error(f"--rows {foreign[0]}: {chosen.task} has: {', '.join(rows)}")
    if chosen.task == "quad8":
        chosen.target = chosen.target or quad8.TARGET
    return Plan(
        chosen.task,
        tuple(dict.fromkeys(chosen.rows or rows)),
        tuple(dict.fromkeys(chosen.seeds)),
        chosen.out.resolve(),
        chosen.results.resolve(),
        chosen.frames,
        tuple(chosen.set),
        tuple(chosen.identify),
        chosen.target,
    )


if __name__ == "__main__":
    sys.exit(main())
