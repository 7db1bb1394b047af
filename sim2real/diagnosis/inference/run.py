"""A diagnosis: one likelihood judges every explanation of the gap in some windows.

    found = find_causes(about)                  # found.made.report
    find_mistakes(data)                         # ["ctrl.elbow: multiply by -1"]

Where windows start from an estimate (`ground`), that estimate is the model's as given. Once causes
are known it is made again with them in the model, and those that promised something are judged anew
on these windows.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from envs.effects import merge_effects
from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.progress import Moving
from sim2real.diagnosis.data.simulate import Work
from sim2real.diagnosis.data.windows import cut_one, is_driven
from sim2real.diagnosis.inference.baseline import Baseline
from sim2real.diagnosis.inference.conclusion import Conclusion, effects_of, make_conclusion
from sim2real.diagnosis.inference.judge import Judge, Judgement
from sim2real.diagnosis.inference.log_changes import find_reach
from sim2real.diagnosis.inference.vocabulary import Vocabulary

FEWEST = 6  # windows that are judged

Restart = Callable[[Sequence[Fixed]], Data]


class About(NamedTuple):
    """What a diagnosis is about."""

    data: Data
    exclude: Sequence[str]  # names of effects that explain nothing
    fixed: Sequence[Fixed]  # effects that are in the model
    rng: np.random.Generator  # for all intervals
    moving: Moving  # receives what is being tried
    work: Work  # counts what is simulated
    # returns the windows whose starts were estimated with some effects in the model; None: starts
    # are known. Where it is given, logs are taken as they are: an estimate was made of them
    restart: Restart | None = None


class Causes(NamedTuple):
    """What a diagnosis comes to, and on which windows."""

    data: Data
    baseline: Baseline
    judgement: Judgement
    made: Conclusion


def find_causes(about: About) -> Causes:
    """Judge what may explain the gap, and conclude.

    Raises:
        Sim2RealError: a model that cannot follow the logs.
    """
    baseline, judgement = _judge(about, about.data)
    found = effects_of(judgement.best)
    if about.restart is not None and found:
        data = about.restart(merge_effects(about.fixed, found))
        fitted = judgement.best, *judgement.rivals
        labels = {member.law for fit in fitted for member in fit.hypothesis.members}
        del baseline, judgement, fitted  # their likelihoods take memory
        baseline, judgement = _judge(about, data, labels)
    made = make_conclusion(judgement, baseline, about.rng)
    return Causes(judgement.judge.data, baseline, judgement, made)


def _judge(
    about: About, data: Data, only: Collection[str] | None = None
) -> tuple[Baseline, Judgement]:
    """Return the gap as given in some windows, and the judgement on it; see `Vocabulary`."""
    trusted = about.restart is not None
    data = data if trusted else skip_ends(data)
    data = spread_windows(data, data.settings.inference.judged_s)
    judge = Judge(data, about.fixed, about.rng, about.work, about.moving)
    baseline = Baseline.of(judge.replayer, about.rng)
    vocabulary = Vocabulary(data, about.exclude, about.fixed, log=not trusted, only=only)
    return baseline, judge.judge(vocabulary)


def find_mistakes(data: Data, fixed: Sequence[Fixed] = ()) -> list[str]:
    """Return what to mend in a log whose own mistakes explain the gap.

    It is a first look, at part of the windows. It ends where they show no gap, or none that one
    mistake closes: a robot that differs from its model is seldom explained by a mistake in the log,
    and what mistakes explain in part may be the robot's. That is left to a diagnosis.
    Effects that are fixed are in the model.

    Raises:
        Sim2RealError: a model that cannot follow the logs.
    """
    brief = replace(data.settings.inference, members_max=1, refits=data.settings.inference.alike)
    data = spread_windows(skip_ends(data), brief.first_s)
    data = replace(data, settings=replace(data.settings, inference=brief))
    judge = Judge(data, fixed)
    if judge.explains(judge.given):
        return []
    vocabulary = Vocabulary(data, robot=False)
    errors, joints = judge.replay_errors(judge.given), [joint.name for joint in data.joints]
    near = judge.search.list_closing(vocabulary.list_starts(errors, joints))
    if not near:
        return []
    tried = judge.find(Vocabulary(data, robot=False, only=near))
    if not judge.is_enough(judge.choose(tried)):
        return []
    judgement = judge.conclude(tried)
    if judgement.verdict != "explained":
        return []
    best = judgement.best
    pairs = zip(best.hypothesis.changes, best.hypothesis.columns, strict=True)
    return [change.mending(best.mean[column]) for change, column in pairs]


def spread_windows(data: Data, seconds: float) -> Data:
    """Return windows of so many seconds in all, but at least `FEWEST`, evenly spread over all."""
    lengths = [float(np.ptp(window.sample)) for window in data.windows]
    most = max(int(seconds / np.mean(lengths)), FEWEST)
    if len(lengths) <= most:
        return data
    return data.only(np.unique(np.linspace(0, len(lengths) - 1, most).round().astype(int)))


def skip_ends(data: Data) -> Data:
    """Return the data without the rows that a shift may leave unknown, at both ends of episodes.

    What was logged at another time is not known there. A window that is cut begins in motion, so
    that servos correct its start before anything is compared.
    """
    windows, mask, measured = list(data.windows), data.mask.copy(), data.measured.copy()
    driven = all(is_driven(data.models[0], joint.qpos) for joint in data.joints)
    ahead = data.settings.windows.warm_s if driven else 0.0
    for place, window in enumerate(data.windows):
        log = data.logs[window.log]
        reach, own = find_reach(log), np.flatnonzero(log.episode == window.episode)
        begin, end = int(own[0]) + reach, int(own[-1]) - reach
        if end <= begin:
            continue  # an episode as short as that is left whole
        there = np.arange(window.first, window.first + len(window.usable))
        kept = window.usable & (there <= end)
        if window.start < begin:
            kept &= log.time[np.minimum(there, own[-1])] >= log.time[begin] + ahead
        if kept.sum() < 2 or (kept == window.usable).all():
            continue
        inside = slice(max(begin - window.first, 0), max(end + 1 - window.first, 0))
        rows = (max(window.start, begin), max(window.first, begin), min(window.last, end + 1))
        args = (window.log, window.model, data.models[window.model], data.joints, rows)
        windows[place] = cut_one(log, *args, data.settings.windows)._replace(usable=kept[inside])
        count = len(windows[place].measured)
        mask[place], mask[place, :count] = False, kept[inside]
        measured[place, :count] = windows[place].measured
    return replace(data, windows=tuple(windows), mask=mask, measured=measured)
