"""How honest is the diagnosis? Its whole exam, and the one on real logs where there are any.

    python -m benchmarks.blindcheck                        # hours; goes on where it was stopped
    python -m benchmarks.blindcheck --experiments blindcheck_small --results outputs/try

Runs the experiments `blindcheck` and, with SIM2REAL_DATA set, `blindcheck_real` in folders of their
own below `outputs/bench_long`, and copies tables and pictures into the results.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

RESULTS = Path(__file__).parent / "results"
OUT = Path("outputs/bench_long")
KEPT = {"table.md": ".md", "cases.csv": ".csv", "plots/matrix.png": ".png"}


def default_experiments() -> list[str]:
    """Return the exams that can be held here."""
    real = ["blindcheck_real"] if "SIM2REAL_DATA" in os.environ else []
    return ["blindcheck", *real]


def hold(experiment: str, out: Path, results: Path) -> int:
    """Run an exam in its folder, keep its tables, and return the exit status."""
    folder = (out / experiment).resolve()
    overrides = [f"+experiment={experiment}", f"hydra.run.dir={folder}", f"resume={folder}"]
    status = subprocess.run([sys.executable, "-m", "sim2real", *overrides]).returncode
    if status == 0:
        results.mkdir(parents=True, exist_ok=True)
        for name, suffix in KEPT.items():
            shutil.copyfile(folder / name, results / f"{experiment}{suffix}")
    return status


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blindcheck",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = ["blindcheck", "blindcheck_small", "blindcheck_real"]
    parser.add_argument("--experiments", nargs="+", choices=names, default=default_experiments())
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the exams")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of what is kept")
    chosen = parser.parse_args(arguments)
    held = [hold(name, chosen.out, chosen.results) for name in chosen.experiments]
    return int(any(held))


if __name__ == "__main__":
    sys.exit(main())
