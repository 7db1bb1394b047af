"""Pictures of a grid of robots: heat maps over two parameters, a line over one.

grid_heatmaps(scores, "heatmaps.png")
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from envs.params import Parameter
from sim2real.evaluation.grid import Axis, Box, Grid
from sim2real.evaluation.scores import GridScores
from sim2real.runs.figures import BOX, cycle, figure, finish, label
from sim2real.runs.statistics import bootstrap, mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# black dashes on white: distinct from every colour of the map, also for colour-blind readers
FRAME = (("white", 3.2, "-"), ("black", 1.6, (0, (3, 2))))


def grid_heatmaps(scores: GridScores, path: str | Path) -> None:
    """Draw the mean return over a grid of two axes: before, after and gained by adaptation.

    Without adaptation there is one map.
    """
    before, after = scores.before.mean(axis=(0, 2)), scores.after.mean(axis=(0, 2))
    maps, gain = {"Mean return": before}, None
    if scores.adaptation_episodes:
        after_title = f"After {scores.adaptation_episodes} episodes of adaptation"
        maps, gain = {"Before adaptation": before, after_title: after}, after - before
    heatmaps(scores.grid, scores.parameters, maps, path, box=scores.box, gain=gain)


def heatmaps(
    grid: Grid,
    parameters: Sequence[Parameter],
    maps: Mapping[str, np.ndarray],
    path: str | Path,
    *,
    box: Box,
    gain: np.ndarray | None = None,
) -> None:
    """Draw maps over one grid of two axes side by side, on one scale, and one of what is gained.

    Args:
        grid: its first axis runs to the right, its second one up.
        parameters: the parameters of the two axes.
        maps: mean return of each cell, (C,), by title.
        path: where the picture goes.
        box: range to frame, by parameter; one of no width is marked as a line or a point.
        gain: by adaptation in each cell, (C,), on a separate scale around 0.
    """
    count = len(maps) + (gain is not None)
    everything = np.concatenate(list(maps.values()))
    low, high = min(0.0, float(everything.min())), float(everything.max())
    width = 3.3 if count <= 3 else 2.6  # inches
    with figure(path, 1, count, (width * count + 0.9, width + 0.2)) as (fig, axes):
        for ax, (title, values) in zip(axes[0], maps.items(), strict=False):
            image = _map(ax, grid, values, title, box, cmap="viridis", vmin=low, vmax=high)
        bar = fig.colorbar(image, ax=list(axes[0, : len(maps)]), pad=0.02, fraction=0.05, aspect=30)
        bar.set_label("Mean return")
        if gain is not None:
            most = max(float(np.abs(gain).max()), 1e-9)
            scale = {"cmap": "RdBu", "vmin": -most, "vmax": most}
            image = _map(axes[0, -1], grid, gain, "Gain by adaptation", box, **scale)
            bar = fig.colorbar(image, ax=axes[0, -1], pad=0.02, aspect=30)
            bar.set_label("Difference of return")
        for ax in axes[0]:
            ax.set_xlabel(label(parameters[0]))
        axes[0, 0].set_ylabel(label(parameters[1]))
        for ax in axes[0, 1:]:
            ax.tick_params(labelleft=False)


def _map(ax: Axes, grid: Grid, values: np.ndarray, title: str, box: Box, **colours: Any) -> Any:
    """Draw one map and its frame."""
    x, y = grid.axes
    image = ax.pcolormesh(x.edges(), y.edges(), values.reshape(grid.shape).T, snap=True, **colours)
    ax.set_title(title)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=2)
    _frame(ax, x, y, box)
    return image


def _frame(ax: Axes, x: Axis, y: Axis, box: Box) -> None:
    """Frame the training range; a point of it is a cross."""
    from matplotlib.patches import Rectangle

    limits = []
    for axis in (x, y):
        low, high = box.get(axis.parameter, (-np.inf, np.inf))
        edges = axis.edges()
        limits.append((max(low, edges[0]), min(high, edges[-1])))
    (left, right), (bottom, top) = limits
    if not box or left > right or bottom > top:
        return
    if left == right and bottom == top:
        for colour, width, _ in FRAME:
            ax.plot(left, bottom, marker="x", color=colour, markersize=8, markeredgewidth=width)
        return
    for colour, width, dashes in FRAME:
        frame = Rectangle((left, bottom), right - left, top - bottom, fill=False)
        frame.set(edgecolor=colour, linewidth=width, linestyle=dashes)
        ax.add_patch(frame)


def grid_line(
    scores: GridScores, path: str | Path, *, draws: int, rng: np.random.Generator
) -> None:
    """Draw the mean return over a grid of one axis, with 95 % intervals of `draws` resamples."""
    (axis,), (parameter,) = scores.grid.axes, scores.parameters
    lines = {"without adaptation": scores.before}
    if scores.adaptation_episodes:
        after = f"after {scores.adaptation_episodes} episodes of adaptation"
        lines = {"before adaptation": scores.before, after: scores.after}
    with figure(path, 1, 1, (6.0, 3.6)) as (_, axes):
        ax = axes[0, 0]
        if axis.parameter in scores.box:
            ends = scores.box[axis.parameter]
            ax.axvspan(*ends, color=BOX, alpha=0.08, linewidth=0, label="training range")
        for colour, (name, values) in zip(cycle(len(lines)), lines.items(), strict=True):
            units = scores.units(values)  # (n, C)
            means = units.mean(axis=0)
            ax.plot(axis.values, means, color=colour, marker="o", markersize=3.5, label=name)
            if len(units) > 1:
                cells = [
                    bootstrap(u[:, None], mean, rng, draws=draws, resample="rows") for u in units.T
                ]
                low, high = [c.low for c in cells], [c.high for c in cells]
                ax.fill_between(axis.values, low, high, color=colour, alpha=0.2, linewidth=0)
        finish(ax, label(parameter), "Mean return")
        ax.legend(loc="best")
