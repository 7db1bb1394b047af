"""The output of `worth`: worth.json, a table, and a picture of radians against return.

    write(worth, Path("outputs/worth"), closed)         # closed: share of the gap, by cause

`closed` comes from the diagnosis: a cause may explain nearly all of the gap and cost nothing, and
one of two per cent may be the fall.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sim2real.evaluation.cause_costs import MEASURES, Cause, CauseCosts, EffectCost
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

SCHEMA = 1
WORDS = {"return": "return lost", "fall": "falls more", "seconds": "seconds lost"}


def write(
    worth: CauseCosts, out: Path, closed: Mapping[int, float], about: Mapping[str, Any]
) -> None:
    """Write worth.json, table.md, table.csv and plots/worth.png into a folder.

    `closed` is the share of the gap that causes close, by their number; `about` says the policy,
    the files and the seed.
    """
    facts = {
        "schema": SCHEMA,
        **about,
        "episodes": worth.episodes,
        "exact": worth.exact,
        "plain": _intervals(worth.plain),
        "every": _intervals(worth.every),
        "causes": [
            {
                **_named(cause),
                "closed": closed.get(k),
                "cost": {name: worth.costs[name][k]._asdict() for name in MEASURES},
                "alone": {name: worth.alone[name][k]._asdict() for name in MEASURES},
                "last": {name: worth.last[name][k]._asdict() for name in MEASURES},
            }
            for k, cause in enumerate(worth.causes)
        ],
        "open": [{**one._asdict(), "cost": _intervals(one.cost)} for one in worth.open],
    }
    write_text(out / "worth.json", json.dumps(facts, indent=1, ensure_ascii=False) + "\n")
    table_of(worth, closed).write(out / "table", "What each cause costs the policy")
    if worth.open:
        open_of(worth.open).write(out / "open", "What the logs do not exclude")
    draw(worth, closed, out / "plots" / "worth.png")


def table_of(worth: CauseCosts, closed: Mapping[int, float]) -> Table:
    """Return a row for each cause, the costliest first."""
    table = Table(("cause", "value", *WORDS.values(), "return lost if alone", "gap closed"))
    costs = worth.costs["return"]
    for k in sorted(range(len(costs)), key=lambda k: -costs[k].value):
        cause = worth.causes[k]
        value = f"{cause.values[0]:.4g} {cause.effect.unit}".strip()
        own = [worth.costs[name][k] for name in MEASURES]
        table.add(cause.label, value, *own, worth.alone["return"][k], closed.get(k))
    plain, every = worth.plain["return"], worth.every["return"]
    falls = worth.plain["fall"].value, worth.every["fall"].value
    table.notes.append(
        f"Return {plain.value:.4g} without and {every.value:.4g} with all of them; falls "
        f"{falls[0]:.0%} and {falls[1]:.0%}. {worth.episodes} episodes on each robot, the same "
        "starts, noise and values on all; costs are Shapley values over "
        + ("every subset" if worth.exact else "drawn orders")
        + ", with 95 % intervals over episodes."
    )
    return table


def open_of(priced: Sequence[EffectCost]) -> Table:
    """Return the costs of effects at the ends of their intervals, the largest first."""
    table = Table(("effect", "value", *WORDS.values()))
    for one in priced:
        label = one.effect + (f" at {one.where}" if one.where else "")
        own = [one.cost[name] for name in MEASURES]
        table.add(label, f"{one.value:.4g} {one.unit}".strip(), *own)
    table.notes.append("On top of all causes, one at a time. Measure the costliest first.")
    return table


def draw(worth: CauseCosts, closed: Mapping[int, float], path: Path) -> None:
    """Draw the return that each cause costs, against the share of the gap that it closes."""
    costs = worth.costs["return"]
    places = closed if closed else {k: float(k) for k in range(len(costs))}
    with figure(path, 1, 1, (5.6, 3.6)) as (_, axes):
        (plot,) = np.ravel(axes)
        plot.axhline(0.0, color=INK, linewidth=0.8)
        for k, place in places.items():
            cost, colour = costs[k], COLOURS[k % len(COLOURS)]
            bars = [[max(cost.value - cost.low, 0.0)], [max(cost.high - cost.value, 0.0)]]
            x = 100 * place if closed else place
            plot.errorbar([x], [cost.value], yerr=bars, fmt="o", color=colour, capsize=3)
            name = worth.causes[k].label.replace("_", " ")
            plot.annotate(name, (x, cost.value), (6, 5), textcoords="offset points", fontsize=8)
        if closed:
            plot.set_xlabel("share of the gap that it closes [% of the radians]")
            plot.set_xlim(-5, 125)
        else:
            plot.set_xticks([])
            plot.set_xlim(-0.5, len(costs) + 0.5)
        plot.set_ylabel("return regained without it")
        plot.set_title("What each cause costs the policy")


def read_diagnosis(path: str | Path) -> dict[str, Any]:
    """Return a report.json of a diagnosis, or a compare.json, as plain data.

    Raises:
        Sim2RealError: a file that is neither.
    """
    place = Path(path).expanduser()
    if place.is_dir():
        names = ("report.json", "compare.json")
        place = next((place / name for name in names if (place / name).is_file()), place / names[0])
    try:
        facts = json.loads(place.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise Sim2RealError(f"{place}: cannot be read ({error})") from None
    if not isinstance(facts, dict) or not ({"causes", "watched"} & set(facts)):
        raise Sim2RealError(
            f"{place} is neither the report.json of a diagnosis nor a compare.json; give one of "
            "these as diagnosis=PATH"
        )
    return facts


def shares_closed(facts: Mapping[str, Any], causes: Sequence[Cause]) -> dict[int, float]:
    """Return which share of the gap each cause closes, by its number; those that are named."""
    found = {}
    for fact in [*facts.get("causes", []), *facts.get("fitted", [])]:
        body = (fact.get("extra") or {}).get("body")
        for k, cause in enumerate(causes):
            place = cause.effect.where
            if fact["effect"] == cause.effect.name and place in (fact.get("where"), body):
                found.setdefault(k, float(fact["closed"]))
    return found


def _named(cause: Cause) -> dict[str, Any]:
    effect = cause.effect
    ends = None if cause.ci is None else list(cause.ci)
    return {
        "effect": effect.name,
        "where": effect.where,
        "side": effect.side,
        "value": cause.values[0] if len(cause.values) == 1 else list(cause.values),
        "ci": ends,
        "unit": effect.unit,
    }


def _intervals(own: Mapping[str, Interval]) -> dict[str, Any]:
    return {name: one._asdict() for name, one in own.items()}
