"""The pictures of docs/how-to/symptoms.md, from recordings that the page's own commands make.

    python -m benchmarks.symptoms                  # records and draws every example
    python -m benchmarks.symptoms sag late         # these only

An example is a block of the page that hides an effect (`echo ... > NAME.yaml`) and records it
(`out=NAME`). Its lines up to the recording run in `outputs/symptoms`. The picture shows the joint
and the seconds in which the model as given is farthest from the robot: the measured angle, replays
of the recorded commands with and without the effect, and the errors of both. The effect is the
hidden one, which the emulator computes by its own equations: no picture depends on a diagnosis.
"""

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.study import command
from envs.effects import load_effects
from hardware.files import atomic_write
from hardware.log import read_log
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import Gap, measure
from sim2real.runs.figures import AFTER, BEFORE, FLOOR

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "how-to" / "symptoms.md"
PICTURES = ROOT / "docs" / "images" / "symptoms"
BLOCK = re.compile(r"^```\n(echo .* > (\w+)\.yaml\nsim2real record .* out=(\w+)\n)", re.MULTILINE)
SPAN = 5.0  # s of a picture
TEXT = "#808080"  # readable on white and on black
SVG: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "symptoms",
    "path.simplify_threshold": 0.5,
}


def examples() -> dict[str, str]:
    """Return the commands of each example of the page, by the name of its recording."""
    blocks = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    return {name: lines for lines, hidden, name in blocks if hidden == name}


def record(name: str, commands: str, work: Path) -> None:
    """Run an example's commands in `work`, unless its recording is there."""
    if not (work / name / "log.csv").is_file():
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path}
        subprocess.run(["bash", "-ec", commands], cwd=work, env=environment, check=True)


def replays(name: str, work: Path) -> tuple[Gap, Gap]:
    """Return a recording's replays in the model as given, and with the hidden effect."""
    log = read_log(work / name / "log.csv")
    spec = load_model(log, None)
    return measure(log, spec), measure(log, spec, load_effects(work / f"{name}.yaml"))


def stretch(gap: Gap) -> tuple[int, slice]:
    """Return the joint and the rows of `SPAN` seconds with the largest squared error."""
    squares = np.nan_to_num((gap.simulated - gap.measured) ** 2)
    joint = int(np.argmax(squares.sum(axis=0)))
    ends = np.searchsorted(gap.log.time, gap.log.time + SPAN)
    sums = np.concatenate([[0.0], np.cumsum(squares[:, joint])])
    first = int(np.argmax((sums[ends] - sums[:-1]) * (gap.log.time + SPAN <= gap.log.time[-1])))
    return joint, slice(first, int(ends[first]))


def draw(before: Gap, after: Gap, path: Path) -> None:
    """Draw angle and error of both replays, readable on a light and on a dark page."""
    joint, rows = stretch(before)
    time = before.log.time[rows] - before.log.time[rows][0]
    measured = before.measured[rows, joint]
    with mpl.rc_context({**SVG, "font.size": 9}):
        picture = Figure(figsize=(6.6, 3.2), layout="constrained")
        angle, error = picture.subplots(2, 1, sharex=True)
        angle.plot(time, measured, color=FLOOR, lw=4, label="measured")
        for gap, colour, dashes, label in (
            (before, BEFORE, "--", "model as given"),
            (after, AFTER, "-", "with the effect"),
        ):
            simulated = gap.simulated[rows, joint]
            angle.plot(time, simulated, color=colour, lw=1.4, ls=dashes, label=label)
            error.plot(time, 1e3 * (simulated - measured), color=colour, lw=1.4, ls=dashes)
        angle.set_ylabel(f"{before.joints[joint]} (rad)")
        error.set(xlabel="time (s)", ylabel="error (mrad)")
        for axes in (angle, error):
            axes.tick_params(colors=TEXT)
            axes.spines[["top", "right"]].set_visible(False)
            axes.spines[["bottom", "left"]].set_color(TEXT)
            axes.xaxis.label.set_color(TEXT)
            axes.yaxis.label.set_color(TEXT)
        picture.legend(loc="outside upper center", ncols=3, frameon=False, labelcolor=TEXT)
        with atomic_write(path) as part:
            picture.savefig(part, format="svg", transparent=True, metadata={"Date": None})


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the pictures that are asked for."""
    parser = command("symptoms", __doc__)
    parser.add_argument("names", nargs="*", help="names of recordings; all if omitted")
    known = examples()
    names = parser.parse_args(arguments).names or list(known)
    if unknown := set(names) - set(known):
        parser.error(f"unknown example {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    work = ROOT / "outputs" / "symptoms"
    work.mkdir(parents=True, exist_ok=True)
    for name in names:
        record(name, known[name], work)
        draw(*replays(name, work), PICTURES / f"{name}.svg")
        print(PICTURES / f"{name}.svg", flush=True)


if __name__ == "__main__":
    main()
