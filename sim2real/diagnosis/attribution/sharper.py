"""What causes leave where the simulator takes no shortcuts: shorter steps, friction that bends.

    sharp = sharper(judge, fit, rest, [])   # Sharp(rest, fit, ...), or None: they leave as much

A time step and rigid dry friction are shortcuts of a model, and no robot takes them. Together they
may leave more than an encoder count, which no cause can mend. So where causes explain a part, they
are looked at again in a quarter of the step, with dry friction that gives way elastically before it
slips (the bristles of `stribeck_friction`). They keep their laws; their values follow by a step of
the fit, since shortcuts bend them too, and the width of the bend is chosen, of a few. What is wrong
stays wrong in the sharper simulation. What is sharp is excused less: nine tenths have to be closed
there, and nothing lasting may be left. What closes less than twice what usual errors of a model
make is not looked at (`usual`): several of these together are followed by one cause nearly as well.
What the shortcuts hid they may have hidden of another cause, too: where a near contender for a
cause's place explains the logs there as well, it was the shortcuts that chose between the two, and
nothing is explained.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

from envs.effects import Effect, make, merge_effects
from envs.plant import Fixed
from sim2real.diagnosis.attribution.fit import Fit, columns, refine
from sim2real.diagnosis.attribution.judge import Judge
from sim2real.diagnosis.attribution.verdict import Rest, is_sound, verdict_of
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.schema import Finding

SHORTCUTS = "shortcuts"  # the finding's name
RULE = "stribeck_friction"  # whose bristles bend
SHARE = 0.97  # of the work that is done then
LEAST = 1e-6  # N·m at standstill: bristles need an effect to belong to, whose own friction is nil


class Sharp(NamedTuple):
    """What causes come to in a sharper simulation.

    Args:
        rest: see `Judge.rest`.
        fit: the causes and their values there.
        step: of the simulation [s].
        bend: at which dry friction slips [rad or m].
        ratio: of critical damping that it has until then.
    """

    rest: Rest
    fit: Fit
    step: float
    bend: float
    ratio: float


def sharper(judge: Judge, fit: Fit, given: Rest, others: Sequence[Fit]) -> Sharp | None:
    """Return what causes leave in a sharper simulation that they alone explain; None: in none.

    Args:
        judge: of these causes.
        fit: the causes and their values.
        given: what they leave in the model as given.
        others: the same with a contender, which the report does not name, in a cause's place.
    """
    data, limits = judge.search.problem.data, judge.search.problem.data.settings.numerics
    if given.closed < limits.closed_min or not is_sound(given, data):
        return None
    finer = data.finer(limits.finer)
    step = max(model.opt.timestep for model in finer.models)
    for bend in limits.bends:
        there, seen = _looked_at(judge, fit, finer, bend, limits.rounds)
        if not _explains(seen, data):
            continue
        for other in others:
            rival = judge._replace(members=other.members)
            if _explains(_looked_at(rival, other, finer, bend, limits.contender_rounds)[1], data):
                return None
        return Sharp(seen, there, step, bend, limits.ratio)
    return None


def _looked_at(judge: Judge, fit: Fit, finer: Data, bend: float, rounds: int) -> tuple[Fit, Rest]:
    """Return causes, refitted in shorter steps where friction bends, and what they leave there."""
    search, problem = judge.search, judge.search.problem
    search.say("looking at them in shorter steps", SHARE)
    own = problem.simulator
    known = merge_effects(own.fixed, tuple(bristles(judge, bend)))
    simulator = Simulator(finer, known, own.threads, own.on_run, own.work)
    there = refine(search.racing.by(simulator), fit.members, fit.values[None], rounds)
    return there, judge.rest(*problem.by(simulator).held_out_each([search.none, there]))


def _explains(rest: Rest, data: Data) -> bool:
    """Return whether what is left is explained without the leniency for an inexact simulator."""
    most = rest.closed >= data.settings.verdict.explained and not rest.unsaid
    return most and verdict_of(rest, data) == "explained"


def bristles(judge: Judge, bend: float) -> Iterator[Fixed]:
    """Yield an effect for each joint whose dry friction bends so far [rad or m] before it slips.

    A joint whose bristles are a cause, or known, keeps those.
    """
    problem = judge.search.problem
    ratio = problem.data.settings.numerics.ratio
    effects = [member.effect for member in judge.members]
    effects += [effect for effect, _ in problem.simulator.fixed]
    for joint in problem.data.joints:
        if not _bends(effects, joint.name):
            bent = make(RULE, where=joint.name, bristle=bend, ratio=ratio)
            yield bent, (LEAST,)


def _bends(effects: Sequence[Effect], joint: str) -> bool:
    """Return whether an effect has bristles of its own at a joint."""
    return any(
        effect.name == RULE and fnmatchcase(joint, "*" if effect.where is None else effect.where)
        for effect in effects
    )


def told(sharp: Sharp, after: float, unit: str) -> Finding:
    """Return a sharper simulation in words.

    Args:
        sharp: see `sharper`.
        after: what causes leave in the model as given, in units of errors.
        unit: of errors: rad, m or spread.
    """
    members, values = sharp.fit.members, sharp.fit.mean
    places = zip(members, columns(members), strict=True)
    length = "m" if unit == "m" else "rad" if unit == "rad" else "rad or m"
    named = " and ".join(f"{member.label} {values[own][0]:.3g}" for member, own in places)
    return Finding(
        SHORTCUTS,
        None,
        f"Of the {after:.2g} {unit} that are left in the model as given, {sharp.rest.after:.2g} "
        f"stay in time steps of {sharp.step * 1e3:.3g} ms with dry friction that gives way by "
        f"{sharp.bend:g} {length} before it slips, and {named}: the difference may be the "
        "simulator's own and needs no further cause.",
        f"Where so little matters, set the model's timestep to {sharp.step:g} and add {RULE} with "
        f"bristle={sharp.bend:g} and ratio={sharp.ratio:g} to every joint.",
    )
