"""What to record next, to tell effects apart that explain the logs alike.

    members = [Member("backlash at elbow", backlash), Member("joint_compliance at elbow", spring)]
    plan = next_experiment(members, spec, floor, rng=np.random.default_rng(0), robot=robot)
    plan.text                               # for a person
    plan.item.motions, plan.item.seconds    # for hardware.excite and run=record

Each motion of a menu, and drawn ones if asked for, is simulated under every member. How far each
pair of them is apart after each has refitted to what the other would show (`apart`) decides. A pair
that no motion parts has no say, since two effects may be one and the same on a robot. Of motions in
which all others are surely parted the shortest wins, changes by hand included, since a longer one
tells nothing more; where none is, the one with the most evidence (the squared distance over the
squared noise, as far as it counts) by its time.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from envs.plant import Fixed
from envs.replay import Recording
from hardware.config import NO_MODEL, Robot, load_robot
from hardware.excite import excite
from sim2real.diagnosis.data.noise_floor import rounding
from sim2real.diagnosis.data.pairs import TWELVE_BITS, is_scalar
from sim2real.diagnosis.data.poses import home
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.experiments.apart import Asked, Member, pairs, refitted, separation
from sim2real.diagnosis.experiments.menu import Item, drawn, menu
from sim2real.diagnosis.settings import DEFAULT
from sim2real.diagnosis.settings import Experiment as Limits
from sim2real.runs.errors import Sim2RealError

GAINS = 2  # places of a law that are gains; a desired speed and a torque follow
KNOWN = "bench1"  # a desk-top robot, whose servo, bus, rate and supply stand in for unknown ones
Scores = dict[Item, np.ndarray]  # motions, and how far each parts each pair, (P,) noise floors


@dataclass(frozen=True)
class Experiment:
    """What to record next.

    Args:
        separation: how far the two most similar members are apart there once they have refitted,
            in noise floors; of those that some motion parts, where there are any.
        most: how far any two members are apart in any motion: below `apart_min`, nothing that was
            looked at parts them.
    """

    text: str  # the recommendation in words, with the command that records it
    item: Item
    separation: float
    most: float
    ranking: tuple[tuple[str, float], ...]  # each motion and its separation, the best one first


def next_experiment(
    members: Sequence[Member],
    spec: mujoco.MjSpec,
    floor: Mapping[str, float],
    *,
    rng: np.random.Generator,
    robot: Robot | None = None,
    fixed: Sequence[Fixed] = (),
    past: Sequence[Recording] = (),
    draws: int = 0,
    exact: int = 0,
    by_hand: bool = True,
    longest: float = math.inf,
    settings: Limits = DEFAULT.experiment,
) -> Experiment:
    """Simulate motions under each member and return what separates them fastest.

    Args:
        members: at least two explanations.
        spec: the model.
        floor: noise of a single run by joint [rad or m].
        rng: the random generator of drawn motions.
        robot: its limits and rate, where it is known; else the model's ranges are used.
        fixed: effects that the robot has in any case.
        past: recordings that the members follow already, and must follow when they refit.
        draws: number of motions that are drawn, besides those of the menu.
        exact: of so many of the best, refits are simulated until they settle, or until that is
            surely enough; of the others they are one linear step.
        by_hand: whether motions count before which something has to be changed.
        longest: duration of a motion at most [s].
        settings: the motions, and the robot where only its model is known.

    Raises:
        Sim2RealError: fewer than two members, no position servo to move, or no motion that all
            members can follow.
    """
    if len(members) <= 1:
        raise Sim2RealError(f"{len(members)} explanation leaves nothing to separate; give two")
    machine = stand_in(spec) if robot is None else robot
    falls = _falls(spec, machine, settings)
    items = [
        item
        for item in (*menu(spec, settings), *drawn(draws, rng, settings))
        if item.seconds <= longest
        and not (falls and "swing" in item.motions)
        and (by_hand or item.change is None)
    ]
    asked = Asked(spec, _noise(spec, floor), tuple(past), tuple(fixed))
    together = [item for item in items if item.change is None]  # one batch: the same model
    groups = [together, *([item] for item in items if item.change is not None)]
    scores: Scores = {}
    for some in filter(None, groups):
        made = [_changed(item, asked, machine, settings) for item in some]
        found = separation(members, [motion for _, motion in made], made[0][0])
        scores |= {i: far for i, far in zip(some, found, strict=True) if np.isfinite(far).all()}
    if not scores:
        raise Sim2RealError("the model diverges in every motion under one of the explanations")

    def refit(item: Item) -> np.ndarray:
        changed, motion = _changed(item, asked, machine, settings)
        return refitted(members, motion, changed)

    best = _looked_at(scores, _Near(settings, scores), exact, refit) or scores
    known, near = {**scores, **best}, _Near(settings, best)
    item, distances = max(best.items(), key=near.worth)
    least, parted = near.least(distances), _Near(settings, known).parted
    alike = [pair for pair, apart in zip(pairs(members), parted, strict=True) if not apart]
    text = _text(item, members, alike, least, bool(near.parted.any()), robot)
    ranked = sorted(known.items(), key=near.worth, reverse=True)
    ranking = tuple((other.name, near.least(found)) for other, found in ranked)
    return Experiment(text, item, least, near.most, ranking)


class _Near:
    """Which pairs of explanations some of the motions part, and what motions are worth for them."""

    def __init__(self, settings: Limits, scores: Scores) -> None:
        self.settings = settings
        furthest = np.nan_to_num(list(scores.values())).max(axis=0)  # (P,)
        self.most = float(furthest.max())
        self.parted = furthest >= settings.apart_min  # (P,)

    def of(self, distances: np.ndarray) -> np.ndarray:
        """Return the distances (P,) that count: of pairs that are parted by some motion."""
        return np.nan_to_num(distances)[self.parted if self.parted.any() else slice(None)]

    def least(self, distances: np.ndarray) -> float:
        """Return the smallest distance of a separable pair; the largest if no pair is separable."""
        own = self.of(distances)
        return float(own.min() if self.parted.any() else own.max())

    def worth(self, scored: tuple[Item, np.ndarray]) -> tuple[bool, float, float]:
        """Return what a motion is worth: the operator's time, where it is sure to be enough.

        Else the evidence that it gives in a second of that time.
        """
        item, distances = scored
        least, time = self.least(distances), item.seconds + self.settings.hand_s * item.needs_hand
        sure = self.settings.apart_sure
        if least >= sure:
            return True, -time, least
        evidence = np.mean(np.minimum(self.of(distances), sure) ** 2)
        return False, float(evidence) * item.seconds / time, least


def _looked_at(
    scores: Scores, near: _Near, exact: int, refit: Callable[[Item], np.ndarray]
) -> Scores:
    """Return the best motions, and those that part furthest, with exact refits.

    No more once one is sure to be enough. Where none of them parts anything, each pair that is
    parted by linear steps is looked at in the motion that parts it furthest.
    """
    best = [item for item, _ in sorted(scores.items(), key=near.worth, reverse=True)][:exact]
    furthest = sorted(scores, key=lambda item: float(scores[item].max()), reverse=True)[:exact]
    own = [max(scores, key=lambda item: scores[item][p]) for p in np.flatnonzero(near.parted)]
    found: Scores = {}
    for item in dict.fromkeys([*best, *furthest, *own]) if exact else ():
        if item not in (*best, *furthest) and _Near(near.settings, found).parted.any():
            break
        found[item] = refit(item)
        if near.parted.any() and near.least(found[item]) >= near.settings.apart_sure:
            break
    return found


def stand_in(spec: mujoco.MjSpec) -> Robot:
    """Return a known robot with a servo for each position actuator of a model in place of its own.

    Raises:
        Sim2RealError: the model has none.
    """
    model, known = spec.copy().compile(), load_robot(KNOWN)
    servos, own = [], known.servos[0]
    for i in filter(partial(is_joint_servo, model), range(model.nu)):
        joint, (low, high) = int(model.actuator_trnid[i, 0]), own.position
        if model.actuator_ctrllimited[i]:
            low, high = model.actuator_ctrlrange[i]
        elif model.jnt_limited[joint]:
            low, high = model.jnt_range[joint]
        ends, name = (float(low), float(high)), model.actuator(i).name
        servos.append(replace(own, name=name, id=len(servos), position=ends))
    if not servos:
        raise Sim2RealError("the model has no position actuator that an experiment could move")
    return replace(known, name="model", model=NO_MODEL, servos=tuple(servos))


def _noise(spec: mujoco.MjSpec, floor: Mapping[str, float]) -> dict[int, float]:
    """Return the noise of one reading by column of the state [rad or m]."""
    model, least = spec.copy().compile(), rounding(TWELVE_BITS)
    return {
        int(model.jnt_qposadr[i]): max(floor.get(model.joint(i).name, 0.0), least)
        for i in range(model.njnt)
        if is_scalar(model, i)
    }


def _changed(item: Item, asked: Asked, robot: Robot, settings: Limits) -> tuple[Asked, Recording]:
    """Return the model in a motion, what it changes in it done, and the motion."""
    spec = asked.spec.copy()
    if item.change is not None:
        item.change(spec)
        asked = asked._replace(changed=spec)
    motion = record_of(item, spec.copy().compile(), robot, settings)
    return asked, motion._replace(law=_repeat_gains(asked.past, len(motion.time)))


def _repeat_gains(past: Sequence[Recording], rows: int) -> np.ndarray | None:
    """Return the usual gains of recordings for each row of another one, (T, nu, 4).

    Nothing else is sent, neither a speed nor a torque. None where no recording has gains.
    """
    laws = [recording.law for recording in past if recording.law is not None]
    if not laws:
        return None
    gains = np.median(np.concatenate(laws), axis=0)
    gains[:, GAINS:] = 0.0
    return np.tile(gains, (rows, 1, 1))


def record_of(
    item: Item, model: mujoco.MjModel, robot: Robot, settings: Limits = DEFAULT.experiment
) -> Recording:
    """Return a motion as a recording of commands, from rest in the robot's middle pose."""
    qpos, ctrl = home(model)
    columns, places = _places(model, robot)
    limits = np.array([servo.position for servo in robot.servos])
    pose = np.clip(ctrl[columns], *limits.T)
    room = np.minimum(pose - limits[:, 0], limits[:, 1] - pose) / np.ptp(limits, axis=1)
    pose = np.where(room < settings.edge, limits.mean(axis=1), pose)
    rng = np.random.default_rng(item.seed)
    plan = excite(robot, pose, item.seconds, item.motions, rng, item.size)
    commands = np.tile(ctrl, (len(plan.angles), 1))
    commands[:, columns] = plan.angles
    powered = np.ones(commands.shape, bool)
    powered[:, columns] = plan.torque[:, None]
    qpos[places] = pose
    time = np.arange(len(commands)) / robot.rate
    return Recording(time, commands, qpos, np.zeros(model.nv), powered)


def _falls(spec: mujoco.MjSpec, robot: Robot, settings: Limits) -> bool:
    """Say whether a robot that is let go in its middle pose leaves it: it would fall over."""
    model = spec.copy().compile()
    rest = record_of(Item("a hold", ("hold",)), model, robot, settings)
    free = rest._replace(powered=np.zeros(rest.ctrl.shape, bool))
    path = trial(spec, [free])[0][:, _places(model, robot)[1]]
    return not bool(np.abs(path - path[0]).max() < settings.fallen)


def _places(model: mujoco.MjModel, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return where the robot's servos stand in ctrl and in qpos, (n,) each."""
    columns = np.array([model.actuator(name).id for name in robot.names])
    return columns, model.jnt_qposadr[model.actuator_trnid[columns, 0]]


def _text(
    item: Item,
    members: Sequence[Member],
    alike: Sequence[tuple[Member, Member]],
    least: float,
    parted: bool,
    robot: Robot | None,
) -> str:
    """Return what to record, the command for it, and how far apart members are there."""
    name = "NAME" if robot is None else robot.name
    words = [f"robot={name}", f"motions=[{','.join(item.motions)}]", f"seconds={item.seconds:g}"]
    if (item.size, item.seed) != (DEFAULT.experiment.size, 0):
        words += [f"size={item.size:g}", f"seed={item.seed}"]
    first = f"First {item.by_hand}. " if item.by_hand else ""
    if item.override is not None and robot is not None:
        words.append(item.override(robot))
        first = ""
    labels = [member.label for member in members]
    text = (
        f"To tell {', '.join(labels[:-1])} and {labels[-1]} apart, record {item.name}: {first}"
        f"`python -m sim2real run=record {' '.join(words)}`. "
    )
    if not parted:
        return (
            f"{text}Even there they are at most {least:.1f} times the noise apart once each has "
            "refitted: no motion that was looked at separates them on this robot, so in such "
            "motions any of them will do in its simulator."
        )
    apart = f"{least:.0f} times the noise floor apart once each has refitted"
    if not alike:
        return f"{text}There they are {apart}."
    both = ", or ".join(f"{one.label} from {other.label}" for one, other in alike)
    return f"{text}There they are {apart}, but no motion that was looked at separates {both}."
