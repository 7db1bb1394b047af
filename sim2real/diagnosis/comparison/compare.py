"""Has the robot changed between two sets of logs?

    answer = compare("before/", "after/", "arm.xml")
    answer.verdict, [(c.effect, c.where, c.change, c.interval) for c in answer.changes]
    fleet = compare_fleet({"a": "a/", "b": "b/", "c": "c/"}, "arm.xml")

Every log is replayed in the same model with what both sides have; each watched effect has a value
for both and a change. Logs of the same commands are compared row by row, so that what the model
cannot follow cancels. Nothing is named that exchanging before and after makes as likely.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from envs.effects import EFFECTS, load_effects
from envs.errors import did_you_mean
from hardware.log import Log, read_logs
from sim2real.diagnosis.comparison.answer import Change, Comparison, Fleet, Value, Verdict
from sim2real.diagnosis.comparison.changes import as_alike, as_change, as_untold, find_changes
from sim2real.diagnosis.comparison.confounders import SUPPLY, Confounded, confounders, excuse
from sim2real.diagnosis.comparison.permuted import Permuted
from sim2real.diagnosis.comparison.pieces import Pieces, contrasts
from sim2real.diagnosis.comparison.prepared import Prepared, prepare
from sim2real.diagnosis.comparison.response import Watch
from sim2real.diagnosis.report.text import format_place
from sim2real.diagnosis.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

Logs = str | Path | Log | Iterable[str | Path | Log]
UNITS_MIN = 3  # robots of a fleet: of two, nobody can say which one deviates


def compare(
    before: Logs,
    after: Logs,
    model: str | Path | None = None,
    *,
    effects: str | Path | None = None,
    watch: Sequence[str] | None = None,
    limits: Mapping[str, float] | None = None,
    remounted: bool = True,
    seed: int = 0,
    settings: Settings = DEFAULT,
) -> Comparison:
    """Test whether a robot has changed, and in which effects.

    Args:
        before: first set of logs: a path, a folder, logs, or a list of these.
        after: second set of logs.
        model: an MJCF for all logs; None: the model that each log names.
        effects: an effects.yaml of the robot's earlier effects, put into the model first.
        watch: names of effects that may change; None: the effects of the setting `watched`.
        limits: largest acceptable change by effect, in its unit.
        remounted: whether the robot may have been remounted between the recordings.
        seed: seed of the permutations.
        settings: every number that influences the answer.

    Raises:
        Sim2RealError: there are no logs, they name different models, or an effect or limit is
            unknown.
    """
    sides = {"before": before, "after": after}
    asked = _asked(sides, model, effects, watch, limits, remounted, seed, settings)
    first, second = asked.sides.values()
    return _compared(asked, first, second)


def compare_fleet(
    units: Mapping[str, Logs],
    model: str | Path | None = None,
    *,
    effects: str | Path | None = None,
    watch: Sequence[str] | None = None,
    limits: Mapping[str, float] | None = None,
    remounted: bool = True,
    seed: int = 0,
    settings: Settings = DEFAULT,
) -> Fleet:
    """Say which robots of a fleet deviate from all others; arguments are those of `compare`.

    The probability of any false alarm is shared among the robots.

    Raises:
        Sim2RealError: fewer than three robots; see also `compare`.
    """
    if len(units) < UNITS_MIN:
        raise Sim2RealError(
            f"units: expected at least {UNITS_MIN} robots, got {len(units)}; with two robots, give "
            "before= and after="
        )
    sides = {f"units.{name}": own for name, own in units.items()}
    asked = _asked(sides, model, effects, watch, limits, remounted, seed, settings)
    members = dict(zip(units, asked.sides.values(), strict=True))
    return Fleet(_told_apart(asked, members), _values(asked.made.watch))


class _Asked(NamedTuple):
    """What is compared: the logs of all sides, replayed, and the numbers of each side's logs."""

    made: Prepared
    sides: Mapping[str, range]
    limits: Mapping[str, float]
    inputs: Mapping[str, Any]


def _asked(
    sides: Mapping[str, Logs],
    model: str | Path | None,
    effects: str | Path | None,
    watch: Sequence[str] | None,
    limits: Mapping[str, float] | None,
    remounted: bool,
    seed: int,
    settings: Settings,
) -> _Asked:
    """Read and replay the logs of all sides; see `compare` for the arguments."""
    for what, own in sides.items():
        if isinstance(own, Sequence) and not own:
            raise Sim2RealError(f"{what}: no logs; give {what}=PATH")
    limits = limits or {}
    logs = {what: read_logs(own) for what, own in sides.items()}
    names = _names(settings.compared.watched if watch is None else watch, limits)
    (what, first), *rest = logs.items()
    for other, own in rest:
        _refuse_models({what: first, other: own}, model)
    known = [] if effects is None else load_effects(effects)
    every = [log for own in logs.values() for log in own]
    ends = np.cumsum([len(own) for own in logs.values()]).tolist()
    parts = {what: range(a, b) for what, (a, b) in zip(logs, pairwise([0, *ends]), strict=True)}
    inputs = {"model": None if model is None else str(model), "seed": seed, "remounted": remounted}
    return _Asked(prepare(every, model, known, names, settings), parts, limits, inputs)


def _told_apart(asked: _Asked, robots: Mapping[str, range]) -> dict[str, Comparison]:
    """Return what is said of each robot, the odd ones taken out of what it is compared with.

    An odd robot makes all others deviate from a mean that it is part of, but less than it does
    itself: the one that is farthest off is named first, and no longer counts. Of two that are left
    and differ, nobody can say which one is odd.
    """
    kept, said = dict(robots), {}
    while True:
        for name, own in kept.items():
            others = [k for other, logs in kept.items() if other != name for k in logs]
            said[name] = _compared(asked, others, own, len(robots))
        changed = [name for name in kept if said[name].verdict == "changed"]
        if not changed or len(kept) < UNITS_MIN:
            break
        worst = max(changed, key=lambda name: max(said[name].numbers["apart"].values()))
        del kept[worst]
    text = "differs from the only other robot that is left: nobody can say which one is odd"
    for name in kept if changed else ():
        said[name] = replace(said[name], verdict="cannot_tell", reason=text)
    return said


def _compared(
    asked: _Asked, before: Collection[int], after: Collection[int], tests: int = 1
) -> Comparison:
    """Compare two sides; `tests` of them share the probability of a false alarm."""
    made, limits, data = asked.made, asked.limits, asked.made.data
    columns, settings = made.response.columns, data.settings
    alpha = settings.compared.alpha / tests
    beside = confounders(made, before, after, asked.inputs["remounted"])
    first = contrasts(made, made.error, before, after)
    pieces, moved = excuse(first, made, (before, after), beside)
    apart = zip(data.joints, first.rms * data.scale, strict=True)
    numbers = {
        "pieces": len(pieces.curve),
        "pieces_are_logs": pieces.logs,
        "same_motions": pieces.after is None,
        "apart": {joint.name: float(rms) for joint, rms in apart},
        "alpha": alpha,
    }
    names = [[str(data.logs[k].path or "a log") for k in side] for side in (before, after)]
    answer = partial(
        Comparison,
        shared=_values(made.watch),
        confounders=beside.listed,
        numbers=numbers,
        inputs={"before": names[0], "after": names[1], **asked.inputs},
    )
    reason = _untellable(pieces, beside, len(columns), settings.compared.blocks_min)
    if reason is not None:
        return answer("cannot_tell", reason, (), (), (), untold=())
    rng = np.random.default_rng(asked.inputs["seed"])
    permuted = Permuted(pieces, rng, settings.inference.draws)
    left = beside._replace(prior=beside.prior.after(moved))
    found = find_changes(permuted, columns, left, settings, alpha)

    def change(column: int) -> Change:
        limit = limits.get(columns[column].option.name)
        return as_change(columns, found.every, column, limit, moved.get(column, 0.0))

    named = [
        replace(change(one.column), p=one.p, alike=as_alike(columns, one.alike, settings))
        for one in found.named
    ]
    if (size := beside.supply) is not None:  # no statistics: the servos measured it
        own = (SUPPLY, None, None, size, (size, size), "", 0.0)
        named.insert(0, Change(*own, limit=limits.get(SUPPLY), source="measured"))
    watched = [change(column) for column in found.every.columns]
    passed = [c for c in named if c.limit is not None and abs(c.change) <= c.limit]
    changes = [c for c in named if c not in passed]
    untold = as_untold(columns, found)
    judged = _verdict(changes, watched, len(watched) - len(untold), numbers)
    return answer(*judged, tuple(changes), tuple(passed), tuple(watched), untold=untold)


def _untellable(pieces: Pieces, beside: Confounded, columns: int, least: int) -> str | None:
    """Return why nobody can tell whether the robot changed; None: one can."""
    sides = [len(pieces.curve)] if pieces.after is None else np.bincount(pieces.after, minlength=2)
    if min(sides) < least:
        return (
            f"{min(sides)} independent pieces are too few, at least {least} are needed: record "
            "longer, or more often"
        )
    if len({*beside.excused, *beside.ruled_out}) == columns:
        return (
            "all that was watched is put down to temperature or mounting: log the temperature, "
            "give remounted=false, or watch more"
        )
    return None


def _verdict(
    changes: Sequence[Change], watched: Sequence[Change], shown: int, numbers: Mapping[str, object]
) -> tuple[Verdict, str]:
    """Return the verdict and why; `shown` of the watched changes the logs can show."""
    if changes:
        return "changed", f"changed: {_listed(changes)}"
    wide = [c for c in watched if c.limit is not None and max(abs(e) for e in c.interval) > c.limit]
    if wide:
        return "cannot_tell", (
            f"nothing was seen to change, but the intervals of {_listed(wide)} reach beyond their "
            "limits: record longer, or motions that move more"
        )
    if not shown:
        return "cannot_tell", (
            "these logs can show no change of what is watched, however large: record motions that "
            "move more"
        )
    text = f"{numbers['pieces']} pieces, and nothing that chance does not make"
    hidden = len(watched) - shown
    return "unchanged", text + (
        f"; {hidden} of {len(watched)} changes cannot be seen in these logs" if hidden else ""
    )


def _listed(changes: Sequence[Change]) -> str:
    return ", ".join(f"{c.effect} at {format_place(c.effect, c.where)}" for c in changes)


def _values(watch: Watch) -> tuple[Value, ...]:
    return tuple(Value(e.name, w, e.side, float(values[0]), e.unit) for e, w, values in watch.both)


def _names(watch: Sequence[str], limits: Mapping[str, float]) -> tuple[str, ...]:
    """Return the effects to watch; raises Sim2RealError for names and limits that are wrong."""
    for what, given in (("watch", watch), ("limits", limits)):
        for name in given:
            if name not in EFFECTS or not EFFECTS[name].visible_in_replay:
                known = sorted(n for n, e in EFFECTS.items() if e.visible_in_replay)
                raise Sim2RealError(
                    f"{what}: {name!r} is not an effect that a motion can show"
                    f"{did_you_mean(name, known)}; choose one of: {', '.join(known)}"
                )
    for name, limit in limits.items():
        if isinstance(limit, bool) or not isinstance(limit, int | float) or not limit > 0:
            raise Sim2RealError(f"limits.{name}={limit} must be a number above 0")
    return tuple(dict.fromkeys([*watch, *limits]))


def _refuse_models(sides: Mapping[str, Sequence[Log]], model: str | Path | None) -> None:
    """Raise Sim2RealError if two sides name different models, or different joints."""
    names = [side[0].path or what for what, side in sides.items()]
    named = [{str(log.model.resolve()) for log in side if log.model} for side in sides.values()]
    if model is None and all(named) and named[0].isdisjoint(named[1]):
        raise Sim2RealError(
            f"{names[0]} is of {min(named[0])}, and {names[1]} of {min(named[1])}: two models "
            "cannot be compared; give model= if they are the same robot"
        )
    joints = [side[0].joints for side in sides.values()]
    if set(joints[0]).isdisjoint(joints[1]):
        raise Sim2RealError(
            f"{names[0]} has the joints {', '.join(joints[0])}, and {names[1]} "
            f"{', '.join(joints[1])}: these are different robots"
        )
