"""What EASI's study came to: easi.csv, a page and a picture for each task."""

from pathlib import Path

import numpy as np
import yaml

from benchmarks.cases import over_runs, read_csv, write_csv
from benchmarks.easi import quad8
from benchmarks.easi.plan import ENDED, ROUNDS, ROWS, Plan, Row, truth
from benchmarks.easi.steps import prior
from benchmarks.robots import cpu_minutes
from envs.distribution import Distribution
from envs.distribution_file import read as read_distribution
from envs.effects import load_effects
from sim2real.evaluation.transfer import read
from sim2real.identification.outcome import FILE
from sim2real.runs.checkpoint import find, read_metadata
from sim2real.runs.figures import COLOURS, FAINT, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import FEW, Interval
from sim2real.runs.tables import Table

COLUMNS = ("task", "row", "seed", "value", "steps", "cpu_minutes", "settings")
ORACLE, COLLAPSE = 0.95, 5.0  # share of the oracle's; ratio of deviations
TOLD = (  # keys that the study gives its runs
    *("experiment", "seed", "video", "keep_checkpoints", "hydra.run.dir", "resume", "frames"),
    *("params", "params.path", "effects", "start", "run", "log", "model", "checkpoint", "identify"),
    *("eval", "eval.robots.target.effects"),
)
ACROSS, WIDE, HIGH = 4, 2.6, 1.9  # panels in a row; inches of one
Figures = dict[str, dict[int, float]]  # return on the target by row and seed
KINDS = (("easi_200", "easi", COLOURS[0]), ("paper_200", "easi_paper", COLOURS[1]))


def report(plan: Plan) -> None:
    """Write what is complete: easi.csv, a page and, where the target is simulated, a picture."""
    if own := merged(plan, lines(plan)):
        write_text(plan.results / f"easi_{plan.label}.md", page(plan, own))
        if plan.study.target is None:
            draw(plan, plan.results / f"easi_{plan.label}.png")


def merged(plan: Plan, found: list[dict[str, str]]) -> list[dict[str, str]]:
    """Put lines into easi.csv and return the task's; others, and seeds that are not here, stay."""
    path = plan.results / "easi.csv"
    every = [*read_csv(path), *found]
    kept = {(one["task"], one["row"], int(one["seed"])): one for one in every}
    if kept:
        write_csv(path, (kept[key] for key in sorted(kept)))
    return [line for key, line in sorted(kept.items()) if key[0] == plan.label]


def figures_of(own: list[dict[str, str]]) -> Figures:
    """Return the values of a task's lines by row and seed."""
    figures: Figures = {}
    for line in own:
        figures.setdefault(line["row"], {})[int(line["seed"])] = float(line["value"])
    return figures


def lines(plan: Plan) -> list[dict[str, str]]:
    """Return a line for each policy that was evaluated."""
    found = []
    for name in ROWS:
        for folder in sorted((plan.out / plan.label).glob(f"seed*/{name}")):
            seed = int(folder.parent.name.removeprefix("seed"))
            if (told := scored(plan, name, seed)) is None:
                continue
            places = [plan.training(name, seed)]
            if ROWS[name].identify:
                places.append(plan.folder(seed, identified(ROWS[name])))
            minutes = [cpu_minutes(place) for place in places]
            spent = f"{sum(minutes):.1f}" if all(minutes) else ""  # where all of it is known
            words = dict.fromkeys(word for place in places for word in settings(place))
            cells = (plan.label, name, f"{seed}", f"{told[0]:.6g}", f"{told[1]}", spent)
            found.append(dict(zip(COLUMNS, (*cells, " ".join(words)), strict=True)))
    return found


def scored(plan: Plan, name: str, seed: int) -> tuple[float, int] | None:
    """Return what a row's policy earns on the target, and its steps; None: it was not there yet."""
    if plan.study.target:
        if (value := quad8.returned(plan, name, seed)) is None:
            return None
        return value, int(read_metadata(find(plan.training(name, seed)))["frames"])
    files = plan.folder(seed, name).glob("transfer-*.json")
    newest = max(files, key=lambda file: int(file.stem[9:]), default=None)
    if newest is None:
        return None
    (one,) = read(newest)
    return float(one.returns["target"].mean()), one.frames


def identified(row: Row) -> str:
    """Return the folder of what EASI found for a row, below its seed's."""
    return f"identify_{row.identify}_{row.budget}"


def settings(folder: Path) -> list[str]:
    """Return what a run was told beside what the study tells every run."""
    file = folder / ".hydra" / "overrides.yaml"
    if not file.is_file():
        return []
    words = yaml.safe_load(file.read_text(encoding="utf-8"))
    return [word for word in words if word.split("=")[0].lstrip("+") not in TOLD]


def page(plan: Plan, own: list[dict[str, str]]) -> str:
    """Return the page of a task."""
    study, figures = plan.study, figures_of(own)
    table = Table(("robots of the training", "the seed", "ours", "seeds"))
    for row in (row for rows in (*ROUNDS, ENDED) for row in rows):
        if study.rows and row.name not in study.rows:
            continue
        theirs = study.published.get(row.name) if plan.target == study.target else None
        values = list(figures.get(row.name, {}).values())
        words = f"{row.name}: {study.words.get(row.name, row.words)}"
        seed = f"{theirs[0]:g} ± {theirs[1]:g}" if theirs else "–"
        table.add(words, seed, over_runs(values), len(values))
    table.notes.append(
        f"Return on the target, mean over training seeds with 95 % bootstrap intervals.{study.note}"
    )
    words = "" if plan.target is None else f" --target {plan.target}"
    steps = sorted({int(line["steps"]) for line in own})
    hidden = "" if plan.effects is None else f"; the target has {described(plan.effects)}"
    parts = [
        f"# EASI on {plan.label}",
        "",
        f"`python -m benchmarks.easi --task {plan.name}{words}`, {spanned(steps)} environment "
        f"steps a training{hidden}. Settings beside the study's:",
        "",
        *sorted({f"* {line['row']}: {line['settings'] or 'none'}" for line in own}),
        "",
        table.markdown(),
        "## Claims",
        "",
        *(f"* {line}" for line in claims(plan, figures)),
    ]
    return "\n".join(parts) + "\n" + (parameters(plan, figures) if study.target else "")


def described(effects: Path) -> str:
    """Return what a file of effects holds, in words."""
    return ", ".join(f"{effect.label()} {value[0]:g}" for effect, value in load_effects(effects))


def best(figures: Figures) -> Row:
    """Return the row of the most trajectories that EASI was given; of 200 without one."""
    rows = sorted((r for r in ROWS.values() if r.identify == "easi"), key=lambda r: -r.budget)
    return next((row for row in rows if row.name in figures), rows[0])


def parameters(plan: Plan, figures: Figures) -> str:
    """Return the table of what EASI found next to what is hidden; "" where it found nothing."""
    found = answers(plan, identified(best(figures)))
    if not found:
        return ""
    true = truth(plan, found[0].effects)
    table = Table(("parameter", "hidden", "range", "found, mean of each seed"))
    for i, (name, law) in enumerate(zip(found[0].names, prior(plan.home).laws, strict=True)):
        means = ", ".join(f"{one.mean[i]:.3g} ± {one.std[i]:.1g}" for one in found)
        table.add(name, true[name], f"{law.low:.3g} to {law.high:.3g}", means)
    return f"\n## Parameters\n\n{table.markdown()}"


def spanned(steps: list[int]) -> str:
    """Return the least and the largest number of steps, or the one that there is."""
    return " to ".join(f"{number:,}" for number in sorted({steps[0], steps[-1]})) if steps else "no"


def claims(plan: Plan, figures: Figures) -> list[str]:
    """Return a line for each claim about rows that the task has."""
    rows, left = plan.study.rows, best(figures).name
    told = [
        compared(claim, figures, left, right, times)
        for claim, right, times in (
            ("EASI above uniform randomization", "udr", 1.0),
            ("EASI at least 0.95 of the oracle", "oracle", ORACLE),
            ("EASI above its own width elsewhere", "narrow", 1.0),
            ("EASI above its own mean alone", "point", 1.0),
            ("EASI above GARAT", "garat", 1.0),
        )
        if not rows or right in rows
    ]
    return told if rows else [*told, collapse(plan)]


def compared(claim: str, figures: Figures, left: str, right: str, times: float) -> str:
    """Decide whether a row is above a multiple of another, seed by seed."""
    pairs = sorted(set(figures.get(left, {})) & set(figures.get(right, {})))
    if not pairs:
        return f"not run: {claim}"
    apart = [figures[left][seed] - times * figures[right][seed] for seed in pairs]
    found = over_runs(apart)
    if not isinstance(found, Interval):
        return f"undecided: {claim}, by {short(apart[0])} with one seed"
    answer = "undecided"
    if found.excludes(0.0):
        answer = "holds" if found.value > 0 else "contradicted"
    few = ", few seeds" if len(pairs) < FEW else ""
    span = f"{short(found.value)} [{short(found.low)}, {short(found.high)}]"
    return f"{answer}{few}: {claim}, by {span}, {len(pairs)} seeds"


def short(value: float) -> str:
    """Return a difference of returns with one decimal, of small returns with two."""
    return f"{value:.1f}" if abs(value) >= 1 else f"{value:.2f}"


def collapse(plan: Plan) -> str:
    """Decide whether the published critic's answers scatter over seeds five times as much."""
    claim = "between seeds the published critic's means scatter 5 times as much as the robust one's"
    widths = {}
    for _, kind, _ in KINDS:
        every = answers(plan, f"identify_{kind}_200")
        if len(every) < 2:
            return f"not run: {claim}"
        scale = every[0].high - every[0].low
        widths[kind] = (np.array([one.mean for one in every]) / scale).std(axis=0, ddof=1)
    ratio = float(np.median(widths["easi_paper"] / np.maximum(widths["easi"], 1e-12)))
    answer = "holds" if ratio >= COLLAPSE else "contradicted"
    return f"{answer}: {claim}: {ratio:.1f} times, median over parameters"


def answers(plan: Plan, name: str) -> list[Distribution]:
    """Return the distributions of that name, of all seeds."""
    files = sorted((plan.out / plan.label).glob(f"seed*/{name}/{FILE}"))
    return [read_distribution(file) for file in files]


def draw(plan: Plan, path: Path) -> None:
    """Draw each parameter over the generations: means and widths of every seed, and the target."""
    before = prior(plan)
    target = truth(plan, before.effects)
    down = -(-(len(before.names) + 1) // ACROSS)
    with figure(path, down, ACROSS, (WIDE * ACROSS, HIGH * down)) as (_, axes):
        panels = list(np.ravel(axes))
        for i, name in enumerate(before.names):
            ax = panels[i]
            for row, kind, colour in KINDS:
                for folder in sorted((plan.out / plan.label).glob(f"seed*/identify_{kind}_200")):
                    told = histories(folder)
                    if told is not None:
                        middle, width = told[:, 0, i], told[:, 1, i]
                        turns = np.arange(len(middle))
                        ax.plot(turns, middle, color=colour, linewidth=1.0, label=row)
                        ax.fill_between(
                            turns, middle - width, middle + width, color=colour, alpha=0.12, lw=0
                        )
            ax.axhline(target[name], color=INK, linewidth=1.0, linestyle="--")
            ax.set_ylim(before.low[i], before.high[i])
            ax.set_title(name, fontsize=8)
        for ax in panels[len(before.names) + 1 :]:
            ax.axis("off")
        legend(panels[len(before.names)])


def legend(ax: object) -> None:
    """Say in an empty panel what the colours mean."""
    from matplotlib.lines import Line2D

    kinds = [(COLOURS[0], "robust critic"), (COLOURS[1], "published critic")]
    handles = [Line2D([], [], color=colour, label=text) for colour, text in kinds]
    handles.append(Line2D([], [], color=INK, linestyle="--", label="target"))
    handles.append(Line2D([], [], color=FAINT, linewidth=6, label="population's deviation"))
    ax.axis("off")  # type: ignore[attr-defined]
    ax.legend(handles=handles, loc="center", title="a line a seed, over generations")  # type: ignore[attr-defined]


def histories(folder: Path) -> np.ndarray | None:
    """Return mean and deviation of each generation's points, (G, 2, P); None without a journal."""
    file = folder / "journal.npz"
    if not file.is_file():
        return None
    with np.load(file, allow_pickle=False) as arrays:
        count = len([name for name in arrays.files if name.startswith("asked.")])
        asked = [arrays[f"asked.{i}"] for i in range(count)]
    return np.array([(points.mean(axis=0), points.std(axis=0)) for points in asked])
