"""The pictures of docs/how-to/symptoms.md, each made by the commands that the page prints.

    python -m benchmarks.symptoms                  # records, diagnoses and draws every example
    python -m benchmarks.symptoms sag late         # these only

An example is a block of the page that ends with `sim2real diagnose NAME/log.csv`. Its lines run in
`outputs/symptoms`; a report that exists there is not made again. The picture shows the joint and
the seconds in which the model as given is farthest from the robot: the measured angle, and replays
of the recorded commands with and without the effects of the diagnosis. The verdict and the causes
are printed, to compare with the page.
"""

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from envs.effects import load_effects
from hardware.files import atomic_write
from hardware.log import read_log
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import Gap, measure
from sim2real.diagnosis.schema import Report
from sim2real.runs.figures import AFTER, BEFORE, FLOOR

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "how-to" / "symptoms.md"
PICTURES = ROOT / "docs" / "images" / "symptoms"
BLOCK = re.compile(r"^```\n((?:(?!```).*\n)*?sim2real diagnose (\w+)/log\.csv\n)```", re.MULTILINE)
SPAN = 5.0  # s of a picture
TEXT = "#808080"  # readable on white and on black
SVG = {"svg.fonttype": "none", "svg.hashsalt": "symptoms", "path.simplify_threshold": 0.5}


def examples() -> dict[str, str]:
    """Return the commands of each example of the page, by the name of its recording."""
    return {name: block for block, name in BLOCK.findall(PAGE.read_text(encoding="utf-8"))}


def run(name: str, commands: str, work: Path) -> Path:
    """Run an example's commands; return the folder of its diagnosis."""
    out = work / f"{name}_diagnosis"
    if not (out / "report.json").is_file():
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        lines = commands.rstrip() + f" out={out.name}"
        subprocess.run(
            ["bash", "-ec", lines], cwd=work, env={**os.environ, "PATH": path}, check=True
        )
    return out


def replays(log_path: Path, diagnosis: Path) -> tuple[Gap, Gap]:
    """Return a log's replays in the model as given, and with the effects of its diagnosis."""
    log = read_log(log_path)
    spec = load_model(log, None)
    effects = diagnosis / "effects.yaml"
    fixed = load_effects(effects) if effects.is_file() else []
    return measure(log, spec), measure(log, spec, fixed)


def stretch(gap: Gap) -> tuple[int, slice]:
    """Return the joint and the rows of `SPAN` seconds with the largest squared error."""
    squares = np.nan_to_num((gap.simulated - gap.measured) ** 2)
    joint = int(np.argmax(squares.sum(axis=0)))
    ends = np.searchsorted(gap.time, gap.time + SPAN)
    sums = np.concatenate([[0.0], np.cumsum(squares[:, joint])])
    first = int(np.argmax((sums[ends] - sums[:-1]) * (gap.time + SPAN <= gap.time[-1])))
    return joint, slice(first, int(ends[first]))


def draw(before: Gap, after: Gap, path: Path) -> None:
    """Draw the measured angle and both replays, readable on a light and on a dark page."""
    joint, rows = stretch(before)
    time = before.time[rows] - before.time[rows][0]
    with mpl.rc_context({**SVG, "font.size": 9}):
        picture = Figure(figsize=(6.6, 2.1), layout="constrained")
        axes = picture.subplots()
        axes.plot(time, before.measured[rows, joint], color=FLOOR, lw=4, label="measured")
        axes.plot(time, before.simulated[rows, joint], color=BEFORE, lw=1.4, ls="--", label="model")
        axes.plot(time, after.simulated[rows, joint], color=AFTER, lw=1.4, label="with the causes")
        axes.set(xlabel="time (s)", ylabel=f"{before.joints[joint]} (rad)")
        axes.tick_params(colors=TEXT)
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["bottom", "left"]].set_color(TEXT)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_color(TEXT)
        picture.legend(loc="outside upper center", ncols=3, frameon=False, labelcolor=TEXT)
        with atomic_write(path) as part:
            picture.savefig(part, format="svg", transparent=True, metadata={"Date": None})


def answer(diagnosis: Path) -> str:
    """Return the verdict and the causes with their intervals."""
    report = Report.from_json(json.loads((diagnosis / "report.json").read_text(encoding="utf-8")))
    causes = [
        f"{cause.effect} at {cause.where or 'the robot'} {cause.value:.3g}"
        f" [{cause.value_ci[0]:.3g}, {cause.value_ci[1]:.3g}] {cause.unit}"
        for cause in report.causes
    ]
    return f"{report.verdict}: {'; '.join(causes) or 'no cause'}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="names of recordings; all if omitted")
    known = examples()
    names = parser.parse_args(arguments).names or list(known)
    if unknown := set(names) - set(known):
        parser.error(f"unknown example {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    work = ROOT / "outputs" / "symptoms"
    work.mkdir(parents=True, exist_ok=True)
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in names:
        diagnosis = run(name, known[name], work)
        draw(*replays(work / name / "log.csv", diagnosis), PICTURES / f"{name}.svg")
        print(f"{name}: {answer(diagnosis)}", flush=True)


if __name__ == "__main__":
    main()
