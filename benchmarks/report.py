"""What a speed comparison leaves behind: bench.json, a table for people, and a picture."""

import json
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from benchmarks.cases import over_runs
from benchmarks.speed import BUSY, Measured
from sim2real.runs import manifest, statistics
from sim2real.runs.figures import AFTER, BEFORE, FLOOR, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import FEW, Interval
from sim2real.runs.tables import Table


class Threshold(NamedTuple):
    """What the ratio of two rows must be, and should be; with neither, it is what bounds others."""

    row: str
    of: str
    must: float | None = None
    goal: float | None = None


THRESHOLDS = (
    Threshold("batched_env_n256", "raw_physics", 0.82, 0.95),
    Threshold("batched_env_n1024", "raw_physics_n1024", 0.90, 0.95),
    Threshold("batched_env_n256_fresh", "raw_physics_fresh", 0.82, 0.95),
    Threshold("batched_env_n1024_fresh", "raw_physics_n1024_fresh", 0.90, 0.95),
    Threshold("batched_env_n256", "envpool", 0.95),
    Threshold("batched_env_n256", "torchrl_gymenv_collector", 9.0),
    Threshold("batched_env_n1024", "torchrl_gymenv_collector", 9.0),
    Threshold("collector", "torchrl_gymenv_collector", 9.0),
    Threshold("es_population", "raw_physics_es", 0.88, 0.95),
    Threshold("raw_physics_es", "es_two_processes_torch"),  # no evaluation can be above this
    Threshold("es_population", "es_two_processes_torch", 2.5),
    Threshold("raw_physics_es", "es_two_processes_numpy"),
    Threshold("es_population", "es_two_processes_numpy", 1.5),
    Threshold("es_population_fresh", "raw_physics_es_fresh", 0.88, 0.95),
    Threshold("es_population_fresh", "es_two_processes_torch_fresh", 2.5),
    Threshold("es_population_fresh", "es_two_processes_numpy_fresh", 1.5),
    Threshold("collector", "raw_physics", 0.80, 0.90),
    Threshold("collector_training", "raw_physics", 0.75, 0.85),
    Threshold("ppo_clip_loss", "ppo_sb3", 0.8, 1.2),
    Threshold("ppo_clip_loss_compiled", "ppo_sb3", 1.3, 1.7),
    Threshold("ppo_fast_loss", "ppo_sb3", 1.5, 2.3),
    Threshold("ppo_same_schedule", "ppo_sb3", 3.0, 4.5),
    Threshold("ppo_tuned", "ppo_sb3", 3.0, 7.5),
    Threshold("ppo_members", "ppo_members_torchrl", 5.0, 8.0),
    Threshold("sac", "sac_sb3", 1.2, 1.5),
    Threshold("pixels_gl", "pixels_gymenv", 15.0, 25.0),
    Threshold("pixels_rays", "pixels_gymenv", 100.0, 150.0),
    Threshold("fit", "fit_sysid", None, 3.0),
)
# the seconds that a run of a row must and should take at most
LIMITS: dict[str, tuple[float, float | None]] = {
    "diagnose_3_joints": (40.0, 15.0),
    "diagnose_6_joints": (100.0, 45.0),
    "contract": (20.0, 5.0),
    "diagnose_quad8_walks": (90.0, 30.0),
    "worth_quad8": (120.0, None),
}
MOST = {"diagnose_6_joints": 2.0}  # GiB that the process of a row must take at most
PACKAGES = (
    "mujoco", "torch", "torchrl", "gymnasium", "envpool", "stable-baselines3", "numpy",
)  # fmt: skip


def machine() -> dict[str, Any]:
    """Return what the figures were taken on."""
    import torch

    versions, where = {}, manifest.machine()
    for name in PACKAGES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    return {
        "cpu": where["cpu"],
        "cores": os.cpu_count(),
        "system": where["system"],
        "python": platform.python_version(),
        "packages": versions,
        "torch_threads": torch.get_num_threads(),
        "omp_num_threads": os.environ.get("OMP_NUM_THREADS"),
    }


def ratios(measured: Sequence[Measured], row: str, of: str | None) -> list[float]:
    """Return a row's rate divided by another's in each round; empty where one of them did not run.

    Two rows of a round are seconds apart, so that what a whole round suffers from cancels.
    """
    runs = {one.row.name: [timing.per_second for timing in one.timings] for one in measured}
    if row not in runs or (of or row) not in runs:
        return []
    return [mine / theirs for mine, theirs in zip(runs[row], runs[of or row], strict=True)]


def document(
    measured: Sequence[Measured], skipped: Sequence[str], machine: dict[str, Any]
) -> dict[str, Any]:
    """Return the content of bench.json."""
    return {
        "machine": machine,
        "rows": [
            {
                "name": one.row.name,
                "per_second": one.per_second,
                "seconds": one.seconds,
                "unit": one.row.unit,
                "of": one.row.of or one.row.name,
                "ratio": _median(ratios(measured, one.row.name, one.row.of)),
                "runs": [timing.per_second for timing in one.timings],
                "other_load_cores": one.loads,
                "setup": one.row.setup,
                "mean_episode_length": one.episode_length,
                "bytes_per_simulation": one.memory,
            }
            for one in measured
        ],
        "thresholds": [
            {**threshold._asdict(), "ratios": ratios(measured, threshold.row, threshold.of)}
            for threshold in THRESHOLDS
        ],
        "skipped": list(skipped),
    }


def table(document: dict[str, Any]) -> str:
    """Return the comparison as Markdown."""
    where, rows = document["machine"], document["rows"]
    columns = ("row", "env steps/s", "s a run", "ratio", "of", "episode", "KiB/simulation")
    every = Table((*columns, "other load, cores", "what"))
    for row in rows:
        load = max(row["other_load_cores"])
        every.add(
            row["name"], _rate(row), _number(row["seconds"], 1), _number(row["ratio"], 3),
            row["of"], _number(row["mean_episode_length"], 0),
            _number(row["bytes_per_simulation"], 0, 1 / 1024),
            f"{load:.2f}{' **busy**' if load > BUSY else ''}", row["setup"],
        )  # fmt: skip
    ran = {row["name"] for row in rows}
    compared = Table(("ratio", "median", "95 %", "range", "must", "goal", "holds"))
    for threshold in document["thresholds"]:
        if {threshold["row"], threshold["of"]} & ran:
            compared.add(*_verdict(**threshold))
    timed = Table(("row", "s a run", "must", "goal", "holds"))
    held = Table(("row", "GiB of memory", "must", "holds"))
    for row in rows:
        name, took, memory = row["name"], row["seconds"], row["bytes_per_simulation"]
        if name not in LIMITS:
            continue
        must, goal = LIMITS[name]
        reached = goal is not None and took <= goal
        holds = "yes, and the goal" if reached else "yes" if took <= must else "**no**"
        timed.add(name, f"{took:.1f}", f"{must:g}", _limit(goal), holds)
        if name in MOST and memory:
            most = memory / 2**30
            holds = "yes" if most <= MOST[name] else "**no**"
            held.add(name, f"{most:.2f}", f"{MOST[name]:g}", holds)
    about = (
        f"{where['cpu']}, {where['cores']} cores; torch threads {where['torch_threads']}, "
        f"OMP_NUM_THREADS {where['omp_num_threads']}; "
        f"medians of {len(rows[0]['runs'])} interleaved rounds; ratios of each round\n"
    )
    shown = [every, compared, *(one for one in (timed, held) if one.rows)]
    skipped = [f"Skipped {line}\n" for line in document["skipped"]]
    return "\n".join([about, *(one.markdown() for one in shown), *skipped])


def _verdict(
    row: str, of: str, must: float | None, goal: float | None, ratios: list[float]
) -> tuple[str, ...]:
    """Return a line of the second table."""
    middle = _median(ratios)
    if middle is None:
        holds = "not run"
    elif goal is not None and middle >= goal:
        holds = "yes, and the goal" if must is not None else "the goal"
    elif must is None:
        holds = "the most that is possible" if goal is None else "not the goal"
    else:
        holds = "yes" if middle >= must else "**no**"
    spread = f"{min(ratios):.3g} to {max(ratios):.3g}" if ratios else ""
    shown = (_number(middle, 3), _interval(ratios), spread, _limit(must), _limit(goal))
    return (f"{row} / {of}", *shown, holds)


def _limit(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def _rate(row: dict[str, Any]) -> str:
    """Return a row's rate, with its unit where that is no environment step."""
    rate = f"{row['per_second']:,.0f}" if row["per_second"] >= 20 else f"{row['per_second']:.2g}"
    return rate if row["unit"] == "env steps" else f"{rate} {row['unit']}"


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None


def _interval(values: Sequence[float]) -> str:
    """Return the bootstrap interval of a median; nothing for fewer rounds than it takes."""
    found = over_runs(values, statistics.median) if len(values) >= FEW else None
    return f"{found.low:.3g} to {found.high:.3g}" if isinstance(found, Interval) else ""


def _number(value: float | None, digits: int, scale: float = 1.0) -> str:
    return "" if value is None else f"{value * scale:.{digits}f}"


def write(document: dict[str, Any], folder: Path) -> None:
    """Write bench.json, table.md and bench.png into the folder, each in one piece."""
    write_text(folder / "bench.json", json.dumps(document, indent=1) + "\n")
    write_text(folder / "table.md", table(document))
    rows = document["rows"][::-1]
    with figure(folder / "bench.png", 1, 1, (10, 0.34 * len(rows) + 1.4)) as (_, axes):
        draw(rows, axes[0, 0])


def draw(rows: Sequence[dict[str, Any]], axes: Any) -> None:
    """Draw bars of the rates, coloured by the physics that each is divided by."""
    from matplotlib.patches import Patch

    ceiling = [row["name"].startswith("raw_physics") for row in rows]
    own = [row["name"].startswith(OWN) or row["name"] in ("sac", "fit") for row in rows]
    colours = [FLOOR if raw else AFTER if ours else BEFORE
               for raw, ours in zip(ceiling, own, strict=True)]  # fmt: skip
    places = range(len(rows))
    axes.barh(places, [row["per_second"] for row in rows], color=colours)
    for place, row in enumerate(rows):
        low, high = min(row["runs"]), max(row["runs"])
        axes.plot([low, high], [place, place], color=INK, linewidth=1.4)
        axes.text(1.08 * high, place, f"{_rate(row)}  ({_number(row['ratio'], 2)})",
                  va="center", fontsize=8)  # fmt: skip
    axes.set_yticks(places, [f"{row['name']}: {row['setup']}"[:WIDE] for row in rows], fontsize=7)
    axes.set_xlabel("environment steps a second (ratio to the row it is compared with); lines: "
                    "slowest and fastest round")  # fmt: skip
    axes.set_xscale("log")
    axes.margins(y=0.01)
    axes.set_xlim(right=8 * max(row["per_second"] for row in rows))
    axes.spines[["top", "right"]].set_visible(False)
    legend = {"physics alone": FLOOR, "this project": AFTER, "others": BEFORE}
    marks = [Patch(color=colour, label=name) for name, colour in legend.items()]
    axes.legend(handles=marks, loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=3)


WIDE = 70  # letters of a label
OWN = (
    *("batched_env", "collector", "es_population", "ppo_same", "ppo_tuned"),
    *("pixels_gl", "pixels_rays", "diagnose"),
)
