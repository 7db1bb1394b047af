"""Pictures of results, drawn without a screen, the same style everywhere.

    learning_curve({"es_dr": [run0 / "metrics.csv", run1 / "metrics.csv"]}, "curve.png")
    bars({"udr": 1122.0}, "bars.png")

Colours are those of Okabe and Ito (2008) and the maps viridis and a red-blue one: all of them
hold for colour-blind readers. Axes carry units; what is uncertain is shaded, and the caption says
over what.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats as scipy_stats

from envs.params import Parameter
from hardware.files import atomic_write
from sim2real.runs.errors import Sim2RealError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")
BEFORE, AFTER, FLOOR = COLOURS[1], COLOURS[0], "#a9afb9"  # a gap, here as in a diagnosis's report
INK, FAINT, BOX = "#222222", "#d9d9d9", "#e31a1c"
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "savefig.facecolor": "white",
}
DPI = 150
METRICS = {"kl": "KL divergence (nat)"}  # labels other than the name
LOGARITHMIC = ("train/kl",)  # sizes that lie decades apart
WORDS = {"link_mass": "mass", "ground_friction": "ground friction coefficient"}


@contextmanager
def figure(
    path: str | Path, rows: int, columns: int, size: tuple[float, float]
) -> Iterator[tuple[Figure, np.ndarray]]:
    """Yield a figure and its (rows, columns) axes, and save it as `path` when the block ends.

    Args:
        path: a .png, .svg or .pdf.
        rows: axes from top to bottom.
        columns: axes from left to right.
        size: width and height of the figure, inches.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        fig = Figure(figsize=size, layout="constrained")
        FigureCanvasAgg(fig)
        yield fig, fig.subplots(rows, columns, squeeze=False)
        with atomic_write(path) as temporary:
            fig.savefig(temporary, dpi=DPI)


def label(parameter: Parameter) -> str:
    """Return an axis label: `Torso mass (kg)` for `link_mass.torso`."""
    effect, _, rest = parameter.name.partition(".")
    words = WORDS.get(effect, effect)
    place = parameter.where or ""
    text = " ".join([place, words, rest.removeprefix(place).strip(".")]).strip().replace("_", " ")
    way = {"add": "added ", "scale": "", "set": ""}[parameter.how]
    unit = "factor" if parameter.how == "scale" else parameter.unit
    text = way + text
    return text[0].upper() + text[1:] + (f" ({unit})" if unit else "")


def learning_curve(
    runs: Mapping[str, Sequence[str | Path]],
    path: str | Path,
    *,
    x: str = "train/frames",
    y: str = "train/return",
    draws: int = 2000,
    seed: int = 0,
) -> None:
    """Draw a metric over environment steps: for each label its runs' mean and 95 % interval.

    Args:
        runs: metrics.csv files of each label's training seeds. A single run is drawn without an
            interval.
        path: where the picture goes.
        x: column of the horizontal axis.
        y: column of the vertical axis.
        draws: resamples of the interval.
        seed: the seed of the resamples.

    Raises:
        Sim2RealError: a file without these columns or without a row that has both.
    """
    rng = np.random.default_rng(seed)
    with figure(path, 1, 1, (6.4, 3.6)) as (_, axes):
        ax = axes[0, 0]
        for colour, (name, files) in zip(cycle(len(runs)), runs.items(), strict=True):
            curves = [read_curve(file, x, y) for file in files]
            _curve(ax, curves, colour, name, draws, rng)
        finish(ax, _words(x), _words(y))
        if y in LOGARITHMIC:
            ax.set_yscale("log")
        ax.xaxis.set_major_formatter(_engineering())
        ax.set_xlim(left=0)
        if len(runs) > 1 or any(len(files) > 1 for files in runs.values()):
            ax.legend(loc="best")


def read_curve(path: str | Path, x: str, y: str) -> np.ndarray:
    """Read two columns of a metrics.csv, (2, n), rows in which one is empty left out.

    Raises:
        Sim2RealError: a missing column, or no row with both.
    """
    with Path(path).open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        for name in (x, y):
            if name not in (reader.fieldnames or ()):
                raise Sim2RealError(
                    f"{path} has no column {name!r}; it has: {', '.join(reader.fieldnames or ())}"
                )
        points = [(float(row[x]), float(row[y])) for row in reader if row[x] and row[y]]
    if not points:
        raise Sim2RealError(f"{path} has no row with both {x} and {y}")
    return np.array(points).T


def _curve(
    ax: Axes,
    curves: Sequence[np.ndarray],
    colour: str,
    name: str,
    draws: int,
    rng: np.random.Generator,
) -> None:
    """Draw the mean of curves (2, n) where all of them have data, with its interval."""
    start, stop = max(c[0, 0] for c in curves), min(c[0, -1] for c in curves)
    x = np.linspace(start, stop, 200) if len(curves) > 1 else curves[0][0]
    values = np.stack([np.interp(x, *curve) for curve in curves])  # (seeds, n)
    many = len(curves) > 1
    ax.plot(
        x,
        values.mean(axis=0),
        color=colour,
        label=f"{name} ({len(curves)} seeds)" if many else name,
    )
    if many:
        low, high = scipy_stats.bootstrap(
            (values,), np.mean, axis=0, n_resamples=draws, method="percentile", rng=rng
        ).confidence_interval
        ax.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)


def finish(ax: Axes, x: str, y: str) -> None:
    """Label the axes, with a grid."""
    ax.grid()
    ax.set_xlabel(x)
    ax.set_ylabel(y)


def _words(metric: str) -> str:
    """Return `Return (train)` for `train/return`, and the axis that frames are."""
    if metric == "train/frames":
        return "Environment steps"
    group, _, name = metric.rpartition("/")
    if name in METRICS:
        return METRICS[name]
    return name.replace("_", " ").capitalize() + (f" ({group})" if group else "")


def cycle(count: int) -> list[str]:
    """Return as many colours as there are lines."""
    return [COLOURS[i % len(COLOURS)] for i in range(count)]


def _engineering() -> Any:
    from matplotlib.ticker import EngFormatter

    return EngFormatter(sep=" ")
