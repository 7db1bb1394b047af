"""The command line of the comparisons; `python -m benchmarks --help`."""

from __future__ import annotations

import argparse
import difflib
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

LONG = (  # modules; each resumes, but for the first, which takes minutes
    *("diagnosis", "bus", "toys", "transfer", "pixels", "improve", "hopper_grid", "robots"),
    *("easi", "xl330", "so101"),
)
EXAM = "sim2real +experiment={0} hydra.run.dir={1}/{0} resume={1}/{0}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparisons that were asked for; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description="Speed and, with --long, returns."
    )
    add, usual = parser.add_argument, "(default: %(default)s)"
    add("--long", action="store_true", help="the comparisons of returns (hours; they resume)")
    rows = "speed rows with commas between; default: all but diagnose_6_joints"
    add("--rows", default="", help=rows)
    add("--repeats", type=int, default=3, help=f"rounds of the speed rows {usual}")
    add("--scale", type=float, default=1.0, help=f"work of a run; 1 is 2 to 5 s {usual}")
    add("--out", type=Path, default=Path("outputs/bench"), help=f"folder {usual}")
    chosen = parser.parse_args(arguments)
    if chosen.repeats < 1 or not chosen.scale > 0:
        parser.error(
            f"--repeats {chosen.repeats} must be at least 1 and --scale {chosen.scale:g} above 0"
        )
    if chosen.long:
        return run_long()
    # before torch and numpy are imported, here and in the workers
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    return run_speed(parser, chosen)


def run_speed(parser: argparse.ArgumentParser, chosen: argparse.Namespace) -> int:
    """Run the speed rows and write their files."""
    import torch

    from benchmarks.report import document, machine, table, write
    from benchmarks.speed import compare, default_rows

    torch.set_num_threads(1)
    rows = default_rows(chosen.scale)
    wanted = [name for name in chosen.rows.split(",") if name]
    for name in wanted:
        names = [row.name for row in rows]
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            parser.error(f"no row {name!r}{hint}; there are: {', '.join(names)}")
    rows = [row for row in rows if (row.name in wanted if wanted else not row.long)]
    result = document(
        *compare(rows, chosen.repeats, lambda line: print(line, file=sys.stderr, flush=True)),
        machine(),
    )
    write(result, chosen.out)
    print(table(result))
    return 0


def run_long() -> int:
    """Run the long comparisons, one after another; each goes on where it was stopped."""
    exams = ["blindcheck", *(["blindcheck_real"] if "SIM2REAL_DATA" in os.environ else [])]
    lines = [f"benchmarks.{name}" for name in LONG]
    lines += [EXAM.format(name, "outputs/bench_long") for name in exams]
    ended = [subprocess.run([sys.executable, "-m", *line.split()]).returncode for line in lines]
    return int(any(ended))


if __name__ == "__main__":
    sys.exit(main())
