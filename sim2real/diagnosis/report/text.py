"""A report in words: numbers with units that fit them, names of effects, the verdict's sentence.

quantity(0.0503, "rad")                    # '50.3 mrad'
sentence(report)                           # 'Backlash at the elbow explains 95 % of the gap.'
"""

import math
from collections.abc import Mapping, Sequence

from envs.effects import EFFECTS
from sim2real.diagnosis.schema import Cause, Report
from sim2real.diagnosis.settings import TINY

SMALL = {"rad": "mrad", "m": "mm", "s": "ms", "N·m": "mN·m", "kg": "g", "V": "mV"}  # thousandths
PERCENT, THOUSAND = 100.0, 1e3
COARSE = 0.1  # N·m or kg: below it thousandths are shown, of other units below 1
DIGITS, LEAST = 3, 1e-3  # of a number, and the smallest that is shown
PLACES, MOST = 7, 1e6  # decimals, and the size, beyond which a number has an exponent
HALF, TENTH = 0.005, 0.0005  # shares that round to a percent, and to a tenth of one
NOISE = 2.0  # floors that noise accounts for
SINGLY = 4  # causes that a sentence names with their places
CROWD = 2  # causes at one joint that may stand for a missing law: benchmarks/notebook/exam.md
EVERYWHERE = "all joints alike"
SUBTITLES = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "fitted": "Fitted, not explained",
    "unexplained": "Not explained",
    "no_gap": "No gap",
}


def quantity(value: float | None, unit: str, like: float | None = None) -> str:
    """Return a value with its unit, three digits.

    Args:
        value: a value in `unit`; None is a dash.
        unit: SI, "" for a factor, "spread" for a joint's own motion as the unit.
        like: the value whose prefix is used, so that a row of numbers has one unit.
    """
    if value is None:
        return "–"
    like = value if like is None else like
    number, name = _number(value, unit, like), scaling(unit, like)[1]
    return f"{number}\N{NO-BREAK SPACE}{name}" if name else number


def interval(ends: Sequence[float] | None, unit: str, like: float | None = None) -> str:
    """Return an interval with its unit, `47.1 to 53.0 mrad`; "" where there is none."""
    if ends is None:
        return ""
    low, high = ends
    like = max(abs(low), abs(high)) if like is None else like
    return f"{_number(low, unit, like)} to {quantity(high, unit, like)}"


def scaling(unit: str, like: float) -> tuple[float, str]:
    """Return what values of a size are multiplied by to be shown, and their unit's name then."""
    if unit == "spread":
        return PERCENT, "%"
    if unit in SMALL and abs(like) < (COARSE if unit in ("N·m", "kg") else 1.0):
        return THOUSAND, SMALL[unit]
    return 1.0, unit


def percent(share: float | None) -> str:
    """Return a share as a whole percentage; tenths next to 0 and 100 where they matter."""
    if share is None:
        return "–"
    size = abs(share)
    digits = 1 if TENTH <= size < 2 * HALF or 1 - HALF < size < 1 - TENTH else 0
    return f"{share:.{digits}%}".replace("%", "\N{NO-BREAK SPACE}%")


def degrees(value: float, unit: str) -> str:
    """Return an angle in degrees as well, `2.9°`; "" for anything else."""
    return f"{math.degrees(value):.3g}°".replace("-", "−") if unit == "rad" else ""


def format_effect(effect: str, where: str | None, side: str | None = None) -> str:
    """Return an effect and its place in words: `backlash at the elbow (link side)`."""
    place = f" at {where}" if where else ""
    return effect_display_name(effect) + place + (f" ({side} side)" if side else "")


def format_cause(cause: Cause) -> str:
    """Return a cause's effect, place and side in words."""
    return format_effect(*place_of(cause), cause.side)


def effect_display_name(effect: str) -> str:
    """Return an effect's standard name in words, its own where it is known here."""
    return EFFECTS[effect].in_words() if effect in EFFECTS else effect.replace("_", " ")


def verdict_sentence(report: Report) -> str:
    """Return the verdict as one plain sentence."""
    gap = report.gap
    if report.verdict == "no_gap":
        return (
            f"Simulation and robot agree: {quantity(gap.before, gap.unit)} is no more than noise"
            " and the few per cent by which any model is off."
        )
    if report.verdict == "unexplained" or not report.values:
        return "There is a gap, and no known effect explains it."
    subject = _and(subjects([place_of(cause) for cause in report.values]))
    if report.verdict == "fitted":
        return (
            f"{len(report.fitted)} fitted values close {percent(gap.closed)} of the gap, too many "
            f"to be called causes: {subject}."
        )
    verb = "explains" if len(report.causes) == 1 else "explain"
    text = f"{subject} {verb} {percent(gap.closed)} of the gap."
    if report.verdict == "partly_explained":
        text = f"{text[:-1]}; the rest has another cause."
    mend = "; ".join(cause.remedy for cause in report.causes if cause.remedy)
    text += f" To fix the log: {mend}." if mend else ""
    return text[0].upper() + text[1:]


def place_of(cause: Cause) -> tuple[str, str | None]:
    """Return a cause's effect and where a person looks for it: a body, or all joints alike."""
    where = cause.extra.get("body") or cause.where
    effect = f"{cause.effect} in the log" if cause.kind == "log" else cause.effect
    return effect, where or (EVERYWHERE if cause.shared else None)


def format_place(effect: str, where: str | None) -> str:
    """Return an effect's place; in words where it is at all joints alike, or of the robot."""
    everywhere = effect in EFFECTS and EFFECTS[effect].place in ("joint", "actuator")
    return where or (EVERYWHERE if everywhere else "the robot")


def subjects(causes: Sequence[tuple[str, str | None]]) -> list[str]:
    """Return causes (effect, place) in words; many are grouped by effect."""
    if len(causes) <= SINGLY:
        return [format_effect(effect, where) for effect, where in causes]
    places: dict[str, list[str | None]] = {}
    for effect, where in causes:
        places.setdefault(effect, []).append(where)
    found = []
    for effect, own in places.items():
        many = f"{effect_display_name(effect)} at {len(own)} places"
        found.append(format_effect(effect, own[0]) if len(own) == 1 else many)
    return found


def details(report: Report) -> str:
    """Return the sentences below the verdict: the gap, what is left of it, and what to doubt."""
    more = (residual_sentence(report), deviation_sentence(report), same_joint_warning(report))
    return " ".join(filter(None, (_errors_sentence(report), *more)))


def _errors_sentence(report: Report) -> str:
    """Return the gap before and after against the floor, as sentences."""
    gap = report.gap
    floor = quantity(gap.noise_floor, gap.unit)
    motion = " of the joints' own motion" if gap.unit == "spread" else ""
    on = " on held-out data" if gap.held_out else ""
    if gap.after is None:
        return f"The noise floor of these recordings is {floor}{motion}."
    if not report.values:
        return (
            f"Simulation error: {quantity(gap.before, gap.unit)}{motion}. The noise floor is"
            f" {floor}. No effect that was tried reduces the error{on}."
        )
    these = "this effect" if len(report.causes) == 1 else "these effects"
    these = "these values" if report.fitted else these
    return (
        f"Simulation error{on}: {quantity(gap.before, gap.unit)}{motion} as given,"
        f" {quantity(gap.after, gap.unit)} with {these}. The noise floor is {floor}."
    )


def deviation_sentence(report: Report) -> str:
    """Return which small deviations of parameters account for what is left; else ""."""
    found = [
        f"{format_effect(one.effect, one.where)}{f' ({one.variant})' if one.variant else ''}"
        f", {_signed(one.change)} ({_signed(one.change_ci[0])} to {_signed(one.change_ci[1])})"
        for one in report.deviations[:SINGLY]
    ]
    if not found:
        return ""
    subject = "Small deviations of the model's parameters"
    return f"{subject} would account for the rest: {'; '.join(found)}."


def _signed(share: float) -> str:
    """Return a share as a percentage with a sign."""
    return f"{share:+.1%}".replace("%", "\N{NO-BREAK SPACE}%").replace("-", "−")


def residual_sentence(report: Report) -> str:
    """Return what an explained gap leaves, if noise cannot account for it; else ""."""
    gap = report.gap
    if report.verdict != "explained" or not gap.after or gap.after <= NOISE * gap.noise_floor:
        return ""
    floors = gap.after / max(gap.noise_floor, TINY)
    return (
        f"What is left is {floors:.1f} times the noise floor: a model's usual errors, or a smaller"
        " effect."
    )


def same_joint_warning(report: Report) -> str:
    """Return a warning where several effects at one joint are named as causes; else ""."""
    places = [cause.where for cause in report.causes if cause.where and not cause.shared]
    joint = max(places, key=places.count, default="")
    if places.count(joint) < CROWD:
        return ""
    return (
        f"{places.count(joint)} effects are named at {joint}. Together they can imitate an effect"
        " that is missing: confirm each of them in isolation."
    )


def label(text: str) -> str:
    """Return a rung's label in words: `+ coulomb_friction.elbow` is Coulomb friction at elbow."""
    if text == "as given":
        return "model as given"
    head, dot, place = text.partition(".")
    return " ".join(map(effect_display_name, head.split(" "))) + (f" at {place}" if dot else "")


def numerics(found: Mapping[str, str]) -> list[str]:
    """Return what the tests of the simulator itself say, as sentences."""
    fine = [name.replace("_", " ") for name, text in found.items() if text == "ok"]
    said = [f"{name.replace('_', ' ')}: {text}" for name, text in found.items() if text != "ok"]
    if fine:
        whole = "the gap is not due to numerics: " if not said else ""
        verb = "makes" if len(fine) == 1 else "make"
        said.insert(0, f"{whole}{_and(fine)} {verb} no difference to it.")
    return [text[0].upper() + text[1:] for text in said]


def _and(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _number(value: float, unit: str, like: float) -> str:
    """Return three digits without an exponent where a person would write none.

    Of thousandths and shares, what is next to nothing is said to be that.
    """
    factor, _ = scaling(unit, like)
    value *= factor
    if factor > 1 and 0 < abs(value) < LEAST / 2:
        return f"< {LEAST:g}"
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else str(value)
    places = max(0, DIGITS - 1 - math.floor(math.log10(abs(value))))
    if places > PLACES or abs(value) >= MOST:
        return f"{value:.2e}"
    return f"{value:.{places}f}".replace("-", "−")
