"""How honest is the diagnosis? Its whole exam, and the one on real logs where there are any.

    python -m benchmarks.blindcheck                        # hours; goes on where it was stopped
    python -m benchmarks.blindcheck --experiments blindcheck --processes 2     # on two cores
    python -m benchmarks.blindcheck --experiments blindcheck_small --results outputs/try
    python -m benchmarks.blindcheck --most 0               # the tables of what is answered so far

Runs the experiments `blindcheck` and, with SIM2REAL_DATA set, `blindcheck_real` in folders of their
own below `outputs/bench_long`, and copies tables and pictures into the results.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.study import command

RESULTS = Path(__file__).parent / "results"
OUT = Path("outputs/bench_long")
KEPT = {"table.md": ".md", "cases.csv": ".csv", "plots/matrix.png": ".png"}


def default_experiments() -> list[str]:
    """Return the exams that can be held here."""
    real = ["blindcheck_real"] if "SIM2REAL_DATA" in os.environ else []
    return ["blindcheck", *real]


def hold(
    experiment: str, out: Path, results: Path, processes: int = 1, most: int | None = None
) -> int:
    """Run an exam in its folder, keep its tables, and return the exit status."""
    folder = (out / experiment).resolve()
    overrides = [f"+experiment={experiment}", f"hydra.run.dir={folder}", f"resume={folder}"]
    overrides += [] if most is None else [f"exam.most={most}"]
    command = [sys.executable, "-m", "sim2real", *overrides]
    helpers = [subprocess.Popen(command) for _ in range(processes - 1)]
    status = subprocess.run(command).returncode
    status = max([abs(status), *(abs(helper.wait()) for helper in helpers)])
    if status == 0:
        results.mkdir(parents=True, exist_ok=True)
        for name, suffix in KEPT.items():
            shutil.copyfile(folder / name, results / f"{experiment}{suffix}")
    return status


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run."""
    parser = command("blindcheck", __doc__)
    names = ["blindcheck", "blindcheck_small", "blindcheck_real"]
    parser.add_argument("--experiments", nargs="+", choices=names, default=default_experiments())
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the exams")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of what is kept")
    parser.add_argument("--processes", type=int, default=1, help="programs that share the cases")
    parser.add_argument("--most", type=int, help="cases to diagnose now; 0 writes the tables only")
    chosen = parser.parse_args(arguments)
    if chosen.processes < 1 or (chosen.most or 0) < 0:
        parser.error("--processes must be at least 1, and --most not negative")
    settings = (chosen.out, chosen.results, chosen.processes, chosen.most)
    held = [hold(name, *settings) for name in chosen.experiments]
    return int(any(held))


if __name__ == "__main__":
    sys.exit(main())
