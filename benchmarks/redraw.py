"""The pictures of benchmarks/results, drawn anew from the tables beside them; nothing is measured.

python -m benchmarks.redraw                       # all of them
python -m benchmarks.redraw hopper_grid speed     # these
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks import hopper_gap, hopper_grid, report, robots_report
from envs.effects import make
from envs.simulation import Simulation
from envs.tasks import Hopper
from hardware.files import whole_file
from sim2real.evaluation.grid import Axis, Grid
from sim2real.evaluation.grid_plots import heatmaps
from sim2real.exam import matrix
from sim2real.loops import relearn

RESULTS = Path(__file__).parent / "results"
Rows = list[dict[str, str]]


def rows(path: Path) -> Rows:
    """Read a table."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def grid(folder: Path) -> None:
    """Draw the maps of hopper_grid.csv, each the mean over runs."""
    table = rows(folder / "hopper_grid.csv")
    names = ("link_mass.torso", "ground_friction")
    axes = [Axis(name, tuple(sorted({float(row[name]) for row in table}))) for name in names]
    place = {values: k for k, values in enumerate(map(tuple, Grid(tuple(axes)).cells().tolist()))}
    sums: dict[str, list[list[float]]] = {}
    for row in table:
        cell = place[tuple(float(row[name]) for name in names)]
        for when in ("before", "after"):
            title = f"{row['method']}, {when}"
            sums.setdefault(title, [[] for _ in place])[cell].append(float(row[when]))
    maps = {title: np.array([np.mean(one) for one in cells]) for title, cells in sums.items()}
    shown = {hopper_grid.TITLES[title]: maps[title] for title in hopper_grid.TITLES}
    effects = [make("link_mass", where="torso", how="set"), make("ground_friction")]
    space = Simulation(Hopper(), 1, effects, 1).space.parameters
    heatmaps(Grid(tuple(axes)), space, shown, folder / "hopper_grid.png", box=hopper_grid.BOX)


def gap(folder: Path) -> None:
    """Draw hopper_gap_runs.csv."""
    named = {words: name for name, words in hopper_gap.WORDS.items()}
    found: dict[str, list[list[float]]] = {}
    for row in rows(folder / "hopper_gap_runs.csv"):
        found.setdefault(named[row["trained in"]], []).append([float(row["return on the target"])])
    hopper_gap.draw({n: np.array(v) for n, v in found.items()}, folder / "hopper_gap.png")


def loop(folder: Path) -> None:
    """Draw robot_gap_runs.csv."""
    named = {words: name for name, words in relearn.WORDS.items()}
    found: dict[str, list[relearn.Tried]] = {}
    for row in rows(folder / "robot_gap_runs.csv"):
        here, there = float(row["return there"]), float(row["return on the robot"])
        one = relearn.Tried(simulator=[here], robot=[there])
        found.setdefault(named[row["learned in the simulator"]], []).append(one)
    relearn.draw(found, folder / "robot_gap.png")


def robots(folder: Path) -> None:
    """Draw robots.csv."""
    found: robots_report.Figures = {}
    for row in rows(folder / "robots.csv"):
        seeds = found.setdefault(row["robot"], {})
        seeds.setdefault(int(row["seed"]), {})[row["figure"]] = float(row["value"])
    robots_report.picture(found, folder / "robots.png")


def speed(folder: Path) -> None:
    """Draw speed.json."""
    document = json.loads((folder / "speed.json").read_text(encoding="utf-8"))
    with whole_file(folder / "speed.png") as temporary:
        temporary.write_bytes(report.picture(document))


def exams(folder: Path) -> None:
    """Draw what was named first in blindcheck.csv and blindcheck_real.csv."""
    for name in ("blindcheck", "blindcheck_real"):
        asked = [row for row in rows(folder / f"{name}.csv") if row["kind"] in ("one", "none")]
        pairs = [
            (row["hidden"].split(" ")[0] if row["kind"] == "one" else matrix.NOTHING, row["first"])
            for row in asked
        ]
        matrix.draw(matrix.counted(pairs), folder / f"{name}.png")


PICTURES: dict[str, Callable[[Path], None]] = {
    "blindcheck": exams,
    "hopper_gap": gap,
    "hopper_grid": grid,
    "robot_gap": loop,
    "robots": robots,
    "speed": speed,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and draw; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.redraw",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(PICTURES)}; default: all"
    )
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the tables")
    chosen = parser.parse_args(arguments)
    if unknown := set(chosen.names) - set(PICTURES):
        parser.error(f"{unknown.pop()!r} is none of {', '.join(PICTURES)}")
    for name in chosen.names or PICTURES:
        PICTURES[name](chosen.results)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
