"""The three stages that data pass: the observation, the policy, and what became of the action.

check_observation(stage, rows, about, limits)         # obs.<i> against the raw channels
check_policy(stage, rows, about, actor, limits)       # action.<i> against actor(obs)
check_action(stage, rows, about, limits)              # ctrl.<actuator> against the action
"""

from collections.abc import Callable

import numpy as np

from sim2real.diagnosis.contract.answer import Finding, Stage
from sim2real.diagnosis.contract.decode import Search, decode
from sim2real.diagnosis.contract.description import Description
from sim2real.diagnosis.contract.history import unstack
from sim2real.diagnosis.contract.rebuild import Mistake, Variant, variants
from sim2real.diagnosis.contract.rows import Rows
from sim2real.diagnosis.contract.terms import ContractError, Term
from sim2real.diagnosis.contract.ways import Target
from sim2real.diagnosis.data.noise_floor import step_of
from sim2real.diagnosis.data.pairs import TWELVE_BITS
from sim2real.diagnosis.settings import Contract

Actor = Callable[[np.ndarray], np.ndarray]
ANGULAR = ("joint_position", "joint_velocity", "gyro", "roll_pitch")
NORMALIZED = "subtract the mean and divide by the standard deviation {}"
SAME_DIGITS, FEW_LEVELS = 9, 3  # of a command that rests, fewer levels
FILTERS = np.arange(1, 10) / 10  # weights of the new value, from 0 to 1
LIMITED = "flag.limited"  # 1 in rows in which the robot's guard sent something else


def check_observation(stage: Stage, rows: Rows, about: Description, limits: Contract) -> None:
    """Compare the logged observation with the one rebuilt from the raw channels.

    Raises:
        ContractError: an observation of another size, or a channel that the log lacks.
    """
    seen = rows.numbered("obs")
    if seen is None:
        text = "obs.<i> is not logged, so what the policy saw cannot be compared"
        stage.open("observation", text)
        return
    about.check_size(rows.place, "an observation has", seen.shape[1])
    newest = unstack(stage, _unnormalized(stage, seen, rows, about, limits), about, rows, limits)
    for term, part in about.parts(newest):
        if term.rebuilt:
            stage.add(decode(*_made(part, term, rows, about), rows, limits))
        else:
            text = f"{term.size} numbers have no channel in the log and were not checked"
            stage.open(term.kind, text)


def _made(
    part: np.ndarray, term: Term, rows: Rows, about: Description
) -> tuple[Target, list[Variant]]:
    """Return the logged numbers of a term (T, k), and the ways in which they may be made."""
    ways = variants(term, rows, about)
    if term.kind == "quaternion":  # q and -q are one turn
        part = _one_side(part, term)
        ways = [way._replace(values=_one_side(way.values, term)) for way in ways]
    flipped = "gravity_direction" if term.kind in ("gravity", "accelerometer") else "sign"
    angular = term.kind in ANGULAR
    of = "observation", term.kind, term.elements
    return Target(*of, part, term.scale, angular, about.clip, flipped), ways


def _one_side(turn: np.ndarray, term: Term) -> np.ndarray:
    """Return quaternions (T, 4) whose number at w's place is not below 0."""
    return turn * np.sign(turn[:, [term.elements.index("w")]])


def _unnormalized(
    stage: Stage, seen: np.ndarray, rows: Rows, about: Description, limits: Contract
) -> np.ndarray:
    """Take the described normalizer off, as often as it was put on; add it if that is not once."""
    if about.normalizer is None:
        return seen
    mean, std = about.normalizer
    once = seen * std + mean
    ways = {"was not applied": seen, "was applied twice": once * std + mean}
    before = _rebuilt_misfit(once, rows, about, limits)
    after, text = min((_rebuilt_misfit(way, rows, about, limits), n) for n, way in ways.items())
    if before <= limits.suspect or after > limits.margin * before:
        return once
    fault = "normalizer_missing" if ways[text] is seen else "normalizer_twice"
    words = f"the normalizer {text}", NORMALIZED.format("once")
    found = Finding("observation", fault, "normalizer", *words, before, after)
    stage.findings.append(found)
    return ways[text]


def _rebuilt_misfit(values: np.ndarray, rows: Rows, about: Description, limits: Contract) -> float:
    """Return the median misfit of all rebuilt numbers of the newest frame as described."""
    sizes = [np.zeros(0)]
    for term, part in about.parts(unstack(Stage(), values, about, rows, limits)):
        if term.rebuilt:
            target, ways = _made(part, term, rows, about)
            search = Search(target, rows, limits)
            sizes.append(search.misfit(search.described(ways[0]))[search.seen])
    every = np.concatenate(sizes)
    return float(np.median(every)) if every.size else 0.0


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
    stage: Stage,
    rows: Rows,
    about: Description,
    actor: Actor | None,
    limits: Contract,
    normalizer: np.ndarray | None,
) -> None:
    """Compare the logged action with what the policy makes of the logged observation.

    `actor` maps observations (n, D) to actions (n, A), None if the policy is not there; inside it
    is the `normalizer`, mean and std (2, D), where it says them.

    Raises:
        ContractError: see `actions_of`, or a policy of another number of actions.
    """
    seen, done = rows.numbered("obs"), actions_of(rows, about)
    if actor is None or seen is None:
        what = "no policy was given" if actor is None else "obs.<i> is not logged"
        stage.open("policy", f"{what}, so no action was computed again")
        return
    plain = Variant(None, actor(seen), np.zeros(done.shape[1]))
    if plain.values.shape != done.shape:
        raise ContractError(
            f"the policy returns {plain.values.shape[1]} actions, but {rows.place} has "
            f"{done.shape[1]}; give the policy of this log"
        )
    ways = [plain]
    if normalizer is not None:
        mean, std = normalizer
        text = "is what the policy does with an observation that was {}"
        twice, missing = text.format("normalized twice"), text.format("not normalized")
        once = NORMALIZED.format("once; the policy's file does it by itself")
        before = NORMALIZED.format("before the network")
        for mistake, fed in (
            (Mistake("normalizer_twice", twice, once), (seen - mean) / std),
            (Mistake("normalizer_missing", missing, before), seen * std + mean),
        ):
            ways.append(plain._replace(mistake=mistake, values=actor(fed)))
    ways += _held(rows, plain, limits, "run the policy every control step")
    elements = [str(i) for i in range(done.shape[1])]
    target = Target("policy", "action", elements, done, np.ones(done.shape[1]), False)
    stage.add(decode(target, ways, rows, limits))


def _held(rows: Rows, plain: Variant, limits: Contract, fix: str) -> list[Variant]:
    """Return values that are renewed every few rows only."""
    return [
        Variant(
            Mistake("rate", f"is renewed every {n} rows only", fix),
            rows.older(plain.values, (rows.since - phase) % n),
            plain.offset,
        )
        for n in range(2, limits.ages_max + 2)
        for phase in range(n)
    ]


def check_action(stage: Stage, rows: Rows, about: Description, limits: Contract) -> None:
    """Compare the commands with what the description makes of the actions.

    Raises:
        ContractError: a log without actions, or without the commands of a joint.
    """
    law, names = about.action, list(about.actuators)
    sent, done = rows.matrix([f"ctrl.{name}" for name in names]), actions_of(rows, about)
    if law.law == "logged_goal":
        goals, scale = [f"action.{name}" for name in names], np.ones(len(names))
        if not rows.has(goals):
            text = "action.<actuator> is not logged, so the commands cannot be compared"
            stage.open("ctrl", text)
            return
        plain = Variant(None, rows.matrix(goals), np.zeros(len(names)))
        ways = [plain]
    else:
        if done.shape[1] != sent.shape[1]:
            raise ContractError(
                f"{rows.place}: {done.shape[1]} actions for {sent.shape[1]} actuators; log "
                f"action.0 to action.{sent.shape[1] - 1}, or describe the law as logged_goal"
            )
        scale = law.scale
        plain = Variant(None, np.clip(done, -law.clip, law.clip), law.offset / scale)
        ways = [plain, *_clipped(sent / scale - plain.offset, done, plain, limits)]
    ways += _smoothed(rows, plain) + _held(rows, plain, limits, "send a command every control step")
    step = _resolution(sent)
    cut = rows.columns.get(LIMITED, np.zeros(len(rows))) > 0  # the guard's own doing
    near = _after(cut, limits)
    many = (~near).sum() < limits.rows_min
    apart = _cut(sent, cut, rows, step) if many else near[:, None]
    target = Target("action", "ctrl", names, sent, scale, True, resolution=step, apart=apart)
    found = decode(target, ways, rows, limits)
    if many and all(one.fault == "unexplained" for one in found.findings):
        text = f"the guard cut {cut.sum()} of {len(cut)} rows: what became of actions is unknown"
        stage.open("ctrl", text)
    else:
        stage.add(found)


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
        near = np.convolve(flags, np.ones(rows + 1))[: len(flags)] > 0
        if (~near).sum() >= max((~flags).sum() / 2, limits.rows_min):
            return near
    return flags


def _resolution(sent: np.ndarray) -> np.ndarray:
    """Return the step to which each command (T, k) is rounded, (k,); 0 where it is not.

    A command that rests is taken to be rounded as finely as the others, or as 12 bits a turn are.
    """
    levels = [len(np.unique(np.round(values, SAME_DIGITS))) for values in sent.T]
    rests, found = np.array(levels) < FEW_LEVELS, np.array([step_of(values) for values in sent.T])
    known = found[~rests]
    return np.where(rests, known.min() if known.size else TWELVE_BITS, found)


def _clipped(
    reached: np.ndarray, done: np.ndarray, plain: Variant, limits: Contract
) -> list[Variant]:
    """Return actions (T, A) that were not clipped, or where those were that were reached (T, A)."""
    ways = []
    if not np.array_equal(done, plain.values):
        mistake = Mistake("clip", "is made of actions that were not clipped", "clip the actions")
        ways.append(plain._replace(mistake=mistake, values=done))
    reach = float(np.median(np.abs(reached).max(axis=0)))
    if reach < (1 - limits.suspect) * np.abs(plain.values).max():
        text, fix = f"is made of actions cut at {reach:.4g}", "clip the actions as described"
        mistake = Mistake("clip", text, fix)
        ways.append(plain._replace(mistake=mistake, values=np.clip(done, -reach, reach)))
    return ways


def _smoothed(rows: Rows, plain: Variant) -> list[Variant]:
    """Return commands that went through a filter of first order."""
    text = "is smoothed: {:g} of the new value and {:g} of the last one"
    return [
        Variant(
            Mistake("filter", text.format(share, 1 - share), "send the command unfiltered"),
            rows.smoothed(plain.values, share),
            plain.offset,
        )
        for share in FILTERS
    ]
