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

from benchmarks.easi import quad8, steps
from benchmarks.easi.plan import ROWS, STUDIES, Plan, targets
from benchmarks.easi.report import report
from benchmarks.study import at_least, command


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command("easi", __doc__, "out", "results", "report", "set")
    add = parser.add_argument
    add("--task", default="cartpole", choices=STUDIES, dest="name", help="default: cartpole")
    add("--target", help="another target of the task: NAME of conf/shift/TASK_NAME.yaml")
    add("--rows", nargs="+", choices=ROWS, metavar="ROW", help=f"default: all of {', '.join(ROWS)}")
    add("--seeds", type=at_least(0), nargs="+", default=[0, 1, 2, 3, 4], help="training seeds")
    steps_ = "environment steps of every training; default: the task's"
    add("--frames", type=at_least(1), help=steps_)
    add("--identify", nargs="*", default=[], metavar="KEY=VALUE", help="and of every EASI run")
    chosen = parser.parse_args(arguments)
    only, plan = chosen.__dict__.pop("report"), plan_of(parser, chosen)
    failed = 0 if only else (quad8 if plan.name == "quad8" else steps).run(plan)
    report(plan)
    return int(failed > 0)


def plan_of(parser: argparse.ArgumentParser, chosen: argparse.Namespace) -> Plan:
    """Return what was asked for; what cannot be ends the program with a sentence."""
    if chosen.target is not None and chosen.target not in (known := targets(chosen.name)):
        there = ", ".join(known) or "none"
        parser.error(f"--target {chosen.target}: {chosen.name} has no such target; it has: {there}")
    rows = STUDIES[chosen.name].rows or list(ROWS)
    if foreign := [name for name in chosen.rows or () if name not in rows]:
        parser.error(f"--rows {foreign[0]}: {chosen.name} has: {', '.join(rows)}")
    chosen.target = chosen.target or STUDIES[chosen.name].target
    chosen.rows = chosen.rows or rows
    return Plan(**vars(chosen))


if __name__ == "__main__":
    sys.exit(main())
