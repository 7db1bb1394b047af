"""What randomization gives a policy that moves from a source robot to a target.

    python -m benchmarks.transfer                                   # rows and seeds: hours
    python -m benchmarks.transfer --rows source target udr --seeds 0 1
    python -m benchmarks.transfer --report                          # the tables of what there is

Trains every row with every seed, the most telling first: the main rows, then the other widths, then
the settings of PPO, then further methods. After each round of seeds `run=report` writes its tables
and pictures to benchmarks/results/transfer/.

Each run has a folder of its own: what is complete is skipped, what was interrupted is continued.
Several of these programs may run at once and share the work, such as one on each core:

    for core in 0 1; do taskset -c $core python -m benchmarks.transfer & done
"""

import sys

from benchmarks.study import Row, Study

LONG, SHORT = 500_000, 300_000  # environment steps
WIDTHS = ("0.01", "0.03", "0.05", "0.1", "0.25", "0.5", "0.75")  # beside 0.075, the main row's
SETTINGS = ("ent001", "gamma07", "lr3e3", "nsteps3840", "vf08")

MAIN = (
    Row("source", "ppo_source", 10, (SHORT, LONG)),
    Row("target", "ppo_target", 10, (SHORT, LONG)),
    Row("udr", "udr", 10, (SHORT, LONG), ("params.width=0.075",)),
    Row("ndr", "ndr", 10, (LONG,), ("params.std=0.1",)),
)
SWEEP = tuple(Row(f"udr_{w}", "udr", 5, (SHORT,), (f"params.width={w}",)) for w in WIDTHS)
HYPER = tuple(Row(name, f"ppo_{name}", 5, (SHORT,)) for name in SETTINGS)
BEYOND = (Row("oracle", "oracle", 5, (LONG,)), Row("gru", "ppo_gru_udr", 5, (SHORT,)))
SLOW = tuple(Row(name, name, 5, (SHORT,)) for name in ("sac_source", "sac_target"))
ROUNDS = (MAIN, SWEEP, HYPER, BEYOND, SLOW)
STUDY = Study("transfer", __doc__ or "", ROUNDS, tuple(row.name for row in SLOW))

if __name__ == "__main__":
    sys.exit(STUDY.main())
