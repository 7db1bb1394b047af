"""The prior distribution of the parameters.

prior = of_tasks(params, data)                     # what training draws, such as params=udr
prior = of_candidates("report.json", data)         # what a diagnosis leaves open
prior = of_candidates(["coulomb_friction"], data)  # effects by name, wherever they can be
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from envs.distribution import Distribution, Entry
from envs.effects import Effect, make
from envs.errors import did_you_mean
from envs.marginals import Marginal, uniform
from envs.params import Parameter
from envs.plant import Plant
from envs.randomization import Randomization, Tasks
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.inference.candidates import Candidate, candidates
from sim2real.diagnosis.schema import Cause, Report
from sim2real.identification.data import Recordings
from sim2real.identification.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError


def prior_from_tasks(
    tasks: Tasks, data: Recordings | None = None, beyond: float = 0.0
) -> Distribution:
    """Return the distribution that a training draws from, as a prior.

    Args:
        tasks: a `Randomization`, or a distribution, which is a prior as it is.
        data: whose model says how many parameters an effect has; None where each has one.
        beyond: how far the prior goes on at both ends of a randomization's ranges, in their widths,
            as far as values mean something: a normal law with their mean and deviation. It needs
            data.

    Raises:
        Sim2RealError: tasks of another kind, or without a width.
    """
    if isinstance(tasks, Distribution):
        return check_width(tasks)
    if not isinstance(tasks, Randomization) or not tasks.draws:
        raise Sim2RealError(
            "identify needs a prior: give candidates=PATH/report.json of a diagnosis, "
            "candidates=[effect, ...], or params=NAME with the ranges of a randomization"
        )
    entries = []
    for draw in tasks.draws:
        low, high = draw.reach
        if data is None:
            entries.append(Entry(draw.effect, (uniform(low, high),)))
            continue
        more = beyond * (high - low)
        own = parameters(draw.effect, data)
        law = uniform(low, high)
        ends = [(max(low - more, p.low), min(high + more, p.high)) for p in own]
        wide = tuple(Marginal("normal", law.mean, law.std, a, b) for a, b in ends)
        entries.append(Entry(draw.effect, wide if beyond else (law,) * len(own)))
    return check_width(Distribution(tuple(entries)))


def prior_from_candidates(given: str | Path | Sequence[str], data: Recordings) -> Distribution:
    """Return the prior over a diagnosis's causes and their equivalents, or over effects by name.

    A cause's prior is its interval times three, about its value. An equivalent's, and that of an
    effect by name, spans what its class calls possible on this robot.

    Args:
        given: a report.json or the folder that holds it, or names of effects.
        data: the logs; their model says which places there are.

    Raises:
        Sim2RealError: no such file, a report without causes, or an effect that is unknown or that
            this robot cannot have.
    """
    there = candidates(data.windows, fixed=data.fixed)
    if not isinstance(given, str | Path):
        return check_width(Distribution(tuple(_named(given, there))))
    report = _report(Path(given).expanduser())
    found: dict[str, Entry] = {}
    for cause in report.effects:
        entry = _of_cause(cause, there, data)
        found[entry.effect.label()] = entry
    for cause in report.effects:
        for other in (one for one in cause.equivalent if one.kind == "robot"):
            for one in there:
                if (one.name, one.place) == (other.effect, other.where):
                    found.setdefault(one.effect.label(), _spanning(one))
    if not found:
        raise Sim2RealError(
            f"candidates={given}: the verdict is {report.verdict} without a cause; name effects "
            f"instead, candidates=[effect, ...]"
        )
    return check_width(Distribution(tuple(found.values())))


def check_width(prior: Distribution) -> Distribution:
    """Return the prior; raises Sim2RealError for one without width in some parameter."""
    for name, law in zip(prior.names, prior.laws, strict=True):
        if not law.high > law.low:
            raise Sim2RealError(
                f"the prior of {name} has no width (low = high = {law.low:g}), so nothing can be "
                f"estimated; widen it, or fix the value with effects=PATH"
            )
    return prior


def parameters(effect: Effect, data: Recordings) -> tuple[Parameter, ...]:
    """Return an effect's parameters on the robot of the logs; raises EffectError if it has none."""
    spec = load_model(data.logs[0], data.model)
    return Plant(spec, [effect], fixed=data.fixed).space.parameters


def _report(path: Path) -> Report:
    file = path / "report.json" if path.is_dir() else path
    try:
        return Report.from_json(json.loads(file.read_text(encoding="utf-8")))
    except OSError as error:
        raise Sim2RealError(f"candidates={path}: {error.strerror}") from None
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError, AttributeError) as error:
        raise Sim2RealError(
            f"candidates={path} is not a report.json of a diagnosis ({error}); give one, or names "
            "of effects in brackets: candidates=[coulomb_friction,link_mass]"
        ) from None


def _named(names: Sequence[str], there: Sequence[Candidate]) -> list[Entry]:
    known = sorted({one.name for one in there})
    if not names:
        raise Sim2RealError("candidates=[] names no effect; give one or leave it out")
    for name in names:
        if name not in known:
            raise Sim2RealError(
                f"candidates: this robot cannot have the effect "
                f"{name!r}{did_you_mean(name, known)}; "
                f"choose one of: {', '.join(known)}"
            )
    found: dict[str, Entry] = {}
    for one in there:
        if one.name in names and not (one.shared and len(_places(one.name, there)) > 1):
            found.setdefault(one.effect.label(), _spanning(one))
    return list(found.values())


def _places(name: str, there: Sequence[Candidate]) -> set[str | None]:
    return {one.effect.where for one in there if one.name == name}


def _spanning(one: Candidate) -> Entry:
    """Return an entry from where the effect is absent to the largest value that is possible."""
    every = np.vstack([one.probes, one.neutral])[:, : len(one.neutral) - len(one.effect.free)]
    every = np.clip(every, one.low[: every.shape[1]], one.high[: every.shape[1]])
    laws = tuple(uniform(float(c.min()), float(c.max())) for c in every.T)
    return Entry(_bound(one.effect), laws)


def _bound(effect: Effect) -> Effect:
    """Return the effect with its free extras as constants."""
    if not effect.free:
        return effect
    side = {} if effect.side is None else {"side": effect.side}
    more = {**effect.extra, **effect.options()}
    return make(effect.name, where=effect.where, how=effect.how, **side, **more)


def _of_cause(cause: Cause, there: Sequence[Candidate], data: Recordings) -> Entry:
    """Return a cause's entry: its interval times a factor, within what its parameter means."""
    extra = dict(cause.extra)
    where = extra.pop("body", None) or cause.where
    side = {} if cause.side is None else {"side": cause.side}
    effect = make(cause.effect, where=where, **side, **extra)
    own = parameters(effect, data)
    spans = [one for one in there if (one.name, one.effect.where) == (cause.effect, where)]
    if len(own) != 1 or not cause.value_ci[1] > cause.value_ci[0]:
        if not spans:
            raise Sim2RealError(
                f"{effect.label()} has no interval in the report, and this robot has no such "
                "candidate; name effects instead, candidates=[effect, ...]"
            )
        return Entry(effect, _spanning(spans[0]).laws)
    low, high = (
        cause.value + DEFAULT.interval_factor * (end - cause.value) for end in cause.value_ci
    )
    return Entry(effect, (uniform(max(low, own[0].low), min(high, own[0].high)),))
