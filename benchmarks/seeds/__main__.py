"""Every row of the seeds' tables beside ours: `docs/seeds.md`, and the trainings that fill it.

    python -m benchmarks.seeds                                  # writes the page, trains nothing
    python -m benchmarks.seeds --run nav2d_pg --seeds 0 1 2     # trains, then writes the page
    python -m benchmarks.seeds --run all                        # a day of CPU; several may share
    python -m benchmarks.seeds --list                           # what can be trained, and how long

The page is made of the committed results; trainings add their figures to results/seeds.csv. They go
on where they were stopped.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.seeds.page import load, page
from benchmarks.seeds.train import Plan, collect, run
from benchmarks.study import at_least, command
from sim2real.runs.files import write_text

PAGE = Path(__file__).parents[2] / "docs" / "seeds.md"


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, train what is asked for and write the page; return the status."""
    parser = command("seeds", __doc__, "out", "results")
    add = parser.add_argument
    many = "trainings; --list names them, all: cheapest first"
    add("--run", nargs="+", default=[], metavar="NAME", help=many)
    many = "training seeds; default: as many as a training has"
    add("--seeds", type=at_least(0), nargs="+", help=many)
    add("--list", action="store_true", help="say what can be trained, and end")
    add("--page", type=Path, default=PAGE, help="the page that is written")
    chosen = parser.parse_args(arguments)
    content = load()
    trainings = content["trainings"]
    if unknown := sorted(set(chosen.run) - {"all", *trainings}):
        parser.error(f"no training {unknown[0]!r}; there are: all, {', '.join(trainings)}")
    cheapest = sorted(trainings, key=lambda name: trainings[name]["minutes"])
    plan = Plan(trainings, chosen.out, chosen.results / "seeds.csv")
    if chosen.list:
        for name in cheapest:
            about, typed = trainings[name], " ".join(["sim2real", *plan.words(name)])
            print(f"{name}: {about['runs']} x {about['minutes']} CPU min: {typed}")
        hours = sum(about["runs"] * about["minutes"] for about in trainings.values()) / 60
        print(f"all: {hours:.0f} CPU h")
        return 0
    failed = sum(
        run(name, chosen.seeds or range(trainings[name]["runs"]), plan)
        for name in (cheapest if "all" in chosen.run else chosen.run)
    )
    if plan.out.is_dir():
        collect(plan)
    write_text(chosen.page.resolve(), page(content, chosen.results))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
