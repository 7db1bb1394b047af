"""The three stages that data pass: the observation, the policy, and what became of the action.

report = check_observation(rows, about, limits)       # obs.<i> against the raw channels
report = check_policy(rows, about, actor, limits)     # action.<i> against actor(obs)
report = check_action(rows, about, limits)            # ctrl.<actuator> against the action
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim2real.diagnosis.contract.answer import Finding, Open, findings_of, open_of
from sim2real.diagnosis.contract.decode import Decoded, decode
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.history import unstack
from sim2real.diagnosis.contract.rebuild import Variant, variants
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.terms import ContractError
from sim2real.diagnosis.contract.ways import Target
from sim2real.diagnosis.data.pairs import TWELVE_BITS
from sim2real.diagnosis.settings import Contract

Actor = Callable[[np.ndarray], np.ndarray]
ANGULAR = ("joint_position", "joint_velocity", "gyro", "roll_pitch")
NORMALIZED = "subtract the mean and divide by the standard deviation {}"
SAME_DIGITS, FEW_LEVELS, OFF_GRID = 9, 3, 0.01  # of commands that are rounded to counts
LIMITED = "flag.limited"  # 1 in rows in which the robot's guard sent something else


@dataclass
class Stage:
    """What one stage showed."""

    findings: list[Finding] = field(default_factory=list)
    cannot_tell: list[Open] = field(default_factory=list)
    checked: dict[str, float] = field(default_factory=dict)

    def take(
        self, stage: str, name: str, found: Decoded, elements: list[str], limits: Contract
    ) -> None:
        """Add what was decoded at one place."""
        self.findings += findings_of(stage, name, found, elements, limits)
        self.cannot_tell += open_of(name, found)
        if len(found.static) + len(found.unseen) < len(elements):
            self.checked[f"{stage}: {name}"] = found.left


def check_observation(rows: Rows, about: Description, limits: Contract) -> Stage:
    """Compare the logged observation with the one rebuilt from the raw channels.

    Raises:
        ContractError: an observation of another size, or a channel that the log lacks.
    """
    stage = Stage()
    seen = rows.numbered("obs")
    if seen is None:
        text = "obs.<i> is not logged, so what the policy saw cannot be compared"
        stage.cannot_tell.append(Open("observation", text))
        return stage
    if seen.shape[1] != about.size:
        raise ContractError(
            f"{rows.place}: an observation has {seen.shape[1]} numbers, but {about.name} describes "
            f"{about.size}: {about.says_sizes()}; correct the description's terms"
        )
    seen, wrong = _unnormalized(seen, rows, about, limits)
    stage.findings += wrong
    stack = unstack(seen, about, rows, limits)
    stage.findings += stack.faults
    if stack.open:
        stage.cannot_tell.append(Open("history", "the frames are alike: their order is unknown"))
    start = 0
    for term in about.terms:
        part = stack.newest[:, start : start + term.size]
        start += term.size
        if not term.rebuilt:
            text = f"{term.size} numbers have no channel in the log and were not checked"
            stage.cannot_tell.append(Open(term.kind, text))
            continue
        stage.take("observation", term.kind, _decoded(part, term, rows, about, limits),
                   term.elements, limits)  # fmt: skip
    return stage


def _decoded(part: np.ndarray, term: Any, rows: Rows, about: Description, limits: Contract) -> Any:
    flipped = "gravity_direction" if term.kind in ("gravity", "accelerometer") else "sign"
    angular = term.kind in ANGULAR
    if term.kind == "quaternion":
        part = part * np.sign(part[:, [list(term.order).index("w")]] + 0.0)  # q and -q are one turn
    target = Target(term.kind, term.elements, part, term.scale, angular, about.clip, flipped)
    ways = variants(term, rows, about)
    if term.kind == "quaternion":
        ways = [_one_side(way, term.order) for way in ways]
    return decode(target, ways, rows, limits)


def _one_side(way: Variant, order: str) -> Variant:
    """Return quaternions whose number at w's place is not below 0."""
    place = [order.index("w")]
    return way._replace(values=way.values * np.sign(way.values[:, place] + 0.0))


def _unnormalized(
    seen: np.ndarray, rows: Rows, about: Description, limits: Contract
) -> tuple[np.ndarray, list[Finding]]:
    """Take a described normalizer off, as often as it was put on."""
    if about.normalizer is None:
        return seen, []
    mean, std = about.normalizer
    once = seen * std + mean
    ways = {"": once, "missing": seen, "twice": once * std + mean}
    misfit = {name: _rebuilt_misfit(values, rows, about, limits) for name, values in ways.items()}
    best = min(misfit, key=lambda name: misfit[name])
    if misfit[""] <= limits.suspect or misfit[best] > limits.margin * misfit[""]:
        return once, []
    text = "was not applied" if best == "missing" else "was applied twice"
    fix = NORMALIZED.format("once")
    fault = Finding("observation", f"normalizer_{best}", "normalizer", f"the normalizer {text}",
                    fix, misfit[""], misfit[best])  # fmt: skip
    return ways[best], [fault]


def _rebuilt_misfit(values: np.ndarray, rows: Rows, about: Description, limits: Contract) -> float:
    """Return the median misfit of all rebuilt numbers of the newest frame as described."""
    newest = unstack(values, about, rows, limits).newest
    start, sizes = 0, []
    for term in about.terms:
        part = newest[:, start : start + term.size]
        start += term.size
        if term.rebuilt:
            way = variants(term, rows, about)[0]
            made = term.scale * (rows.older(way.values, way.age) + way.offset)
            use = rows.deep(limits.ages_max)
            spread = np.maximum(made[use].std(axis=0), limits.still * np.abs(term.scale))
            sizes += list(np.sqrt(np.mean((part - made)[use] ** 2, axis=0)) / spread)
    return float(np.median(sizes)) if sizes else 0.0


def actions_of(rows: Rows, about: Description) -> np.ndarray:
    """Return the logged actions, (T, A).

    Raises:
        ContractError: a log without actions, or with another number of them.
    """
    done = rows.numbered("action")
    if done is None:
        raise ContractError(
            f"{rows.place}: the log has no actions; log the policy's output as action.0, "
            "action.1, …, before scale and limits"
        )
    if done.shape[1] != about.action.size:
        raise ContractError(
            f"{rows.place}: an action has {done.shape[1]} numbers, but {about.name} describes "
            f"{about.action.size}; correct action.size or the joints"
        )
    return done


def check_policy(
    rows: Rows,
    about: Description,
    actor: Actor | None,
    limits: Contract,
    normalizer: np.ndarray | None = None,
) -> Stage:
    """Compare the logged action with what the policy makes of the logged observation.

    Args:
        rows: of the logs.
        about: the description.
        actor: observations (n, D) to actions (n, A); None if the policy is not there.
        limits: when a fault is named.
        normalizer: mean and std (2, D) inside the policy, where it says them.

    Raises:
        ContractError: see `actions_of`, or a policy of another number of actions.
    """
    stage, name = Stage(), "action"
    seen, done = rows.numbered("obs"), actions_of(rows, about)
    if actor is None or seen is None:
        what = "no policy was given" if actor is None else "obs.<i> is not logged"
        stage.cannot_tell.append(Open("policy", f"{what}, so no action was computed again"))
        return stage
    ways = _policy_ways(rows, seen, actor, limits, normalizer)
    if ways[0].values.shape != done.shape:
        raise ContractError(
            f"the policy returns {ways[0].values.shape[1]} actions, but {rows.place} has "
            f"{done.shape[1]}; give the policy of this log"
        )
    elements = [str(i) for i in range(done.shape[1])]
    target = Target(name, elements, done, np.ones(done.shape[1]), False)
    found = decode(target, ways, rows, limits)
    stage.take("policy", name, found, elements, limits)
    return stage


def _policy_ways(
    rows: Rows, seen: np.ndarray, actor: Actor, limits: Contract, normalizer: np.ndarray | None
) -> list[Variant]:
    """Return the actions of the logged observation, and of what may have been fed instead."""
    plain = actor(seen)
    none = np.zeros(plain.shape[1])
    ways = [Variant("", "", "", plain, none)]
    if normalizer is not None:
        mean, std = normalizer
        twice, missing = actor((seen - mean) / std), actor(seen * std + mean)
        fix = NORMALIZED.format("once; the policy's file does it by itself")
        text = "is what the policy does with an observation that {}"
        ways += [
            Variant("normalizer_twice", text.format("was normalized twice"), fix, twice, none),
            Variant(
                "normalizer_missing",
                text.format("was not normalized"),
                NORMALIZED.format("before the network"),
                missing,
                none,
            ),
        ]
    return [*ways, *_held(rows, plain, none, limits, "run the policy every control step")]


def _held(
    rows: Rows, values: np.ndarray, offset: np.ndarray, limits: Contract, fix: str
) -> list[Variant]:
    """Return values that are renewed every few rows only."""
    return [
        Variant("rate", f"is renewed every {n} rows only", fix, rows.held(values, n, phase), offset)
        for n in range(2, limits.ages_max + 2)
        for phase in range(n)
    ]


def check_action(rows: Rows, about: Description, limits: Contract) -> Stage:
    """Compare the commands with what the description makes of the actions.

    Raises:
        ContractError: a log without actions, or without the commands of a joint.
    """
    law, stage = about.action, Stage()
    sent = rows.matrix([f"ctrl.{name}" for name in about.actuators])
    done = actions_of(rows, about)
    if law.law == "logged_goal":
        names = [f"action.{name}" for name in about.actuators]
        if not rows.has(names):
            text = "action.<actuator> is not logged, so the commands cannot be compared"
            stage.cannot_tell.append(Open("ctrl", text))
            return stage
        asked, scale = rows.matrix(names), np.ones(len(names))
        offset = np.zeros(len(names))
    else:
        if done.shape[1] != sent.shape[1]:
            raise ContractError(
                f"{rows.place}: {done.shape[1]} actions for {sent.shape[1]} actuators; log "
                f"action.0 to action.{sent.shape[1] - 1}, or describe the law as logged_goal"
            )
        asked, scale = np.clip(done, -law.clip, law.clip), law.scale
        offset = law.offset / law.scale
    step, free = _resolution(sent), rows.columns.get(LIMITED)
    reach = float(np.median(np.abs(sent / scale - offset).max(axis=0)))
    raw = done if law.law == "joint_position" else None
    ways = _action_ways(rows, asked, offset, raw, reach, limits)
    names = list(about.actuators)
    target = Target("ctrl", names, sent, scale, True, resolution=step)
    cut = np.zeros(len(rows), bool) if free is None else free > 0  # the guard's own doing
    near = _after(cut, limits)
    many = (~near).sum() < limits.rows_min
    apart = _cut(sent, cut, rows, step) if many else np.repeat(near[:, None], len(names), axis=1)
    found = decode(target._replace(apart=apart), ways, rows, limits)
    if many and not found.changes:
        text = f"the guard cut {cut.sum()} of {len(cut)} rows: what became of actions is unknown"
        stage.cannot_tell.append(Open("ctrl", text))
        return stage
    stage.take("action", "ctrl", found, names, limits)
    return stage


def _cut(sent: np.ndarray, cut: np.ndarray, rows: Rows, step: np.ndarray) -> np.ndarray:
    """Return which commands (T, k) a guard seems to have cut, in the rows (T,) that say so.

    Those that went as far in one row as they ever do, or lie at an end of where they ever are. It
    is a guess: a guard may limit otherwise.
    """
    far = np.abs(sent - rows.older(sent, 1))
    near = 2 * np.maximum(step, TWELVE_BITS)  # a step lies between two rounded commands
    fast = far >= far.max(axis=0) - near
    low, high = sent.min(axis=0) + near, sent.max(axis=0) - near
    ends = (sent <= low) | (sent >= high)
    return cut[:, None] & (fast | ends | (rows.since == 0)[:, None])


def _after(flags: np.ndarray, limits: Contract) -> np.ndarray:
    """Return which rows (T,) are flagged, or come soon after one that is.

    What was cut may be sent late. As many rows are left out as leave half of the others.
    """
    for rows in range(limits.ages_max, 0, -1):
        near = np.convolve(flags, np.ones(rows + 1))[: len(flags)] > OFF_GRID
        if (~near).sum() >= max((~flags).sum() / 2, limits.rows_min):
            return near
    return flags


def _resolution(sent: np.ndarray) -> np.ndarray:
    """Return the step to which each command (T, k) is rounded, (k,); 0 where it is not.

    A command that rests is taken to be rounded as finely as the others, or as 12 bits a turn are.
    """
    found = np.full(sent.shape[1], np.nan)
    for k, values in enumerate(sent.T):
        levels = np.unique(np.round(values, SAME_DIGITS))
        if len(levels) < FEW_LEVELS:
            continue
        found[k] = 0.0
        step = float(np.diff(levels).min())
        whole = (levels - levels[0]) / step
        if np.abs(whole - np.round(whole)).max() < OFF_GRID:
            found[k] = step
    known = found[~np.isnan(found)]
    return np.where(np.isnan(found), known.min() if known.size else TWELVE_BITS, found)


def _action_ways(
    rows: Rows,
    asked: np.ndarray,
    offset: np.ndarray,
    done: np.ndarray | None,
    reach: float,
    limits: Contract,
) -> list[Variant]:
    """Return what may have become of the actions: as described, unclipped, filtered, held."""
    ways = [Variant("", "", "", asked, offset)]
    if done is not None and not np.array_equal(done, asked):
        text, fix = "is made of actions that were not clipped", "clip the actions"
        ways.append(Variant("clip", text, fix, done, offset))
    if done is not None and reach < (1 - limits.suspect) * np.abs(asked).max():
        cut = np.clip(done, -reach, reach)
        text, fix = f"is made of actions cut at {reach:.4g}", "clip the actions as described"
        ways.append(Variant("clip", text, fix, cut, offset))
    for share in limits.filters:
        text = f"is smoothed: {share:g} of the new value and {1 - share:g} of the last one"
        ways.append(
            Variant(
                "filter", text, "send the command unfiltered", rows.smoothed(asked, share), offset
            )
        )
    return [*ways, *_held(rows, asked, offset, limits, "send a command every control step")]
