"""How long a diagnosis takes, and a fit beside that of `mujoco.sysid`.

    python -m benchmarks.diagnosis                  # about nine minutes on two cores
    python -m benchmarks.diagnosis --repeats 3

The rows of a fit, of a diagnosis on a stand and of walks, and of `worth`, of the speed comparison,
by themselves; what they come to is kept among the results.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence

import benchmarks.__main__ as speed
from benchmarks.study import command

ROWS = "fit_sysid,fit,diagnose_3_joints,diagnose_6_joints,diagnose_quad8_walks,worth_quad8"
KEPT = {"table.md": "diagnosis_speed.md", "bench.json": "diagnosis_speed.json"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, run the rows and keep what they come to."""
    parser = command("diagnosis", __doc__, "out", "results")
    parser.add_argument("--repeats", type=int, default=1, help="rounds (default: %(default)s)")
    parser.add_argument("--scale", type=float, default=1.0, help="of the logs' lengths")
    chosen = parser.parse_args(arguments)
    options = ["--rows", ROWS, "--repeats", str(chosen.repeats), "--scale", str(chosen.scale)]
    status = speed.main([*options, "--out", str(chosen.out)])
    if status == 0:
        chosen.results.mkdir(parents=True, exist_ok=True)
        for name, kept in KEPT.items():
            shutil.copyfile(chosen.out / name, chosen.results / kept)
    return status


if __name__ == "__main__":
    sys.exit(main())
