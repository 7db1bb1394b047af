"""What EASI on quad8 came to: lines of easi.csv, and a page."""

from benchmarks.cases import over_runs
from benchmarks.easi.plan import ROUNDS, Plan, Row, truth
from benchmarks.easi.quad8 import ROWS, TRIALS, returned
from benchmarks.easi.report import COLUMNS, compared, figures_of, merged, settings
from benchmarks.easi.steps import prior
from benchmarks.robots import cpu_minutes
from envs.distribution import Distribution
from envs.distribution_file import read
from envs.effects import load_effects
from sim2real.identification.outcome import FILE
from sim2real.runs.checkpoint import find, read_metadata
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

WORDS = {"udr": "the ranges of params=quad8_servos", "oracle": "what the robot hides"}


def report(plan: Plan) -> None:
    """Write what is complete; figures of other tasks, and of seeds that are not here, stay."""
    own, row = merged(plan, lines(plan)), most(plan)
    found = identified(plan, row)
    if not own:
        return
    parts = [
        f"# EASI on {plan.name}, the emulated robot",
        "",
        f"`python -m benchmarks.easi --task {plan.name} --target {plan.target}`: the robot hides "
        f"{hidden(plan)}. Settings beside the study's:",
        "",
        *sorted({f"* {line['row']}: {line['settings'] or 'none'}" for line in own}),
        "",
        earned(plan, own, row),
        parameters(plan, found) if found else "",
    ]
    plan.results.mkdir(parents=True, exist_ok=True)
    write_text(plan.results / f"easi_{plan.label}.md", "\n".join(parts).rstrip() + "\n")


def most(plan: Plan) -> Row:
    """Return the row of the most trajectories that EASI has answered to; of 200 without one."""
    rows = [row for rows in ROUNDS for row in rows if row.name in ROWS and row.identify]
    rows = sorted(rows, key=lambda row: -row.budget)
    return next((row for row in rows if identified(plan, row)), rows[0])


def hidden(plan: Plan) -> str:
    """Return what the robot hides, in words."""
    values = load_effects(str(plan.effects))
    return ", ".join(f"{effect.label()} {value[0]:g}" for effect, value in values)


def lines(plan: Plan) -> list[dict[str, str]]:
    """Return a line for each policy that has walked."""
    found = []
    for row in (row for rows in ROUNDS for row in rows if row.name in ROWS):
        for folder in sorted((plan.out / plan.label).glob(f"seed*/{row.name}")):
            seed = int(folder.parent.name.removeprefix("seed"))
            value = returned(plan, row.name, seed)
            if value is None:
                continue
            policy = (plan.home if row.name == "udr" else plan).folder(seed, row.name, "policy")
            places = [policy]
            if row.identify:
                places.append(plan.folder(seed, f"identify_{row.identify}_{row.budget}"))
            words = dict.fromkeys(word for place in places for word in settings(place))
            line = dict.fromkeys(COLUMNS, "") | {"task": plan.label, "row": row.name}
            line |= {"seed": f"{seed}", "value": f"{value:.6g}", "settings": " ".join(words)}
            line |= {"steps": f"{int(read_metadata(find(policy))['frames'])}"}
            line |= {"cpu_minutes": f"{sum(map(cpu_minutes, places)):.1f}"}
            found.append(line)
    return found


def earned(plan: Plan, own: list[dict[str, str]], best: Row) -> str:
    """Return the table of returns on the robot, and what it decides."""
    figures = figures_of(own)
    table = Table(("robots of the training", "the seed's Go2", "ours", "seeds"))
    for row in (row for rows in ROUNDS for row in rows if row.name in ROWS):
        theirs = plan.study.published.get(row.name)
        values = list(figures.get(row.name, {}).values())
        words = f"{theirs[0]:g} ± {theirs[1]:g}" if theirs else "–"
        table.add(
            f"{row.name}: {WORDS.get(row.name, row.words)}",
            words,
            over_runs(values),
            len(values),
        )
    table.notes.append(
        f"Return on the emulated robot, {TRIALS} episodes of each policy, mean over training seeds "
        "with 95 % bootstrap intervals. The seed's return is another one, of Go2."
    )
    told = [
        compared("EASI above uniform randomization", figures, best.name, "udr", 1.0),
        compared("EASI at least 0.95 of the oracle", figures, best.name, "oracle", 0.95),
    ]
    return table.markdown() + "\n" + "\n".join(f"* {line}" for line in told) + "\n"


def identified(plan: Plan, row: Row) -> list[Distribution]:
    """Return what EASI found for a row, of all seeds."""
    name = f"seed*/identify_{row.identify}_{row.budget}/{FILE}"
    return [read(file) for file in sorted((plan.out / plan.label).glob(name))]


def parameters(plan: Plan, found: list[Distribution]) -> str:
    """Return the table of what EASI found beside what is hidden."""
    before = found[0]
    true = truth(plan, before.effects)
    table = Table(("parameter", "hidden", "range", "found, mean of each seed"))
    for i, name in enumerate(before.names):
        law = prior(plan.home).laws[i]
        means = ", ".join(f"{one.mean[i]:.3g} ± {one.std[i]:.1g}" for one in found)
        table.add(name, true[name], f"{law.low:.3g} to {law.high:.3g}", means)
    return f"## Parameters\n\n{table.markdown()}"
