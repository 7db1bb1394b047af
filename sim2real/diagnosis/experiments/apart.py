"""How far apart explanations are in motions that nobody recorded yet, once they refit.

    asked = Asked(spec, noise, past, fixed)
    separation(members, motions, asked)         # (K, P) noise floors, after one linear step each
    refitted(members, motion, asked)            # (P,) of one motion, after exact refits

One explanation takes the robot's place, another follows it as well as it can: its values move to
where they fit the new motion and the recordings so far. What is left is what the new recording
would show of it (Atkinson and Fedorov 1975, T-optimal designs), root mean square over time, summed
over joints. Nobody knows which explanation is the robot, so of each of the P pairs of explanations
(`pairs`) the worse direction counts.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations, compress, islice
from typing import NamedTuple, TypeVar

import mujoco
import numpy as np
from scipy.optimize import least_squares

from envs.effects import merge_effects
from envs.plant import Fixed
from envs.replay import Recording
from sim2real.diagnosis.data.trial import trial

T = TypeVar("T")
CHANGE = 0.05  # of a value's distance from neutral: what a sensitivity is taken over
TURNS = 6  # simulations of a refit, but for its slopes: one of one to four values has settled then


class Member(NamedTuple):
    """One of the explanations that the logs leave open: a label and effects with their values."""

    label: str
    fixed: tuple[Fixed, ...]


class Asked(NamedTuple):
    """What motions are simulated with."""

    spec: mujoco.MjSpec
    noise: dict[int, float]  # of one reading by column of the state, {column of qpos: rad or m}
    past: tuple[Recording, ...] = ()  # recordings that the explanations follow already
    fixed: tuple[Fixed, ...] = ()  # effects that the robot has in any case
    changed: mujoco.MjSpec | None = None  # the model in new motions; None: as it was


def pairs(members: Sequence[T]) -> list[tuple[T, T]]:
    """Return the P pairs of explanations, in the order of `separation` and `refitted`."""
    return list(combinations(members, 2))


def separation(members: Sequence[Member], motions: Sequence[Recording], asked: Asked) -> np.ndarray:
    """Return how far each pair of members is apart in each motion, (K, P) noise floors.

    Refits are one linear step. NaN where a member cannot follow the motion.
    """
    views = []
    for member in members:
        model = _Model(member, motions, asked)
        made = model.predicted(model.values)
        views.append((made, model.slopes(model.values, made)))
    return np.array([_worse(views, partial(_left, k, m)) for k, m in enumerate(motions)])


def refitted(members: Sequence[Member], motion: Recording, asked: Asked) -> np.ndarray:
    """Return how far each pair of members is apart in a motion, (P,) noise floors.

    As `separation`, but every refit is simulated until it settles. NaN where a member cannot follow
    the motion.
    """
    models = [_Model(member, [motion], asked) for member in members]
    return _worse(models, partial(_settled, motion))


def _worse(members: Sequence[T], left: Callable[[T, T], float]) -> np.ndarray:
    """Return what is left of each pair in the worse direction, (P,); NaN where it is in one."""
    return np.array([np.minimum(left(a, b), left(b, a)) for a, b in pairs(members)])


class _Model:
    """A member in K motions and in the past."""

    def __init__(self, member: Member, motions: Sequence[Recording], asked: Asked) -> None:
        self.fixed, self.motions, self.asked = member.fixed, motions, asked
        model, low, high, values, sizes = asked.spec.copy().compile(), [], [], [], []
        for effect, own in member.fixed:
            parameters = effect.parameters(model)
            away = [abs(v - p.neutral) for v, p in zip(own, parameters, strict=True)]
            for one, parameter in zip(away, parameters, strict=True):
                units = [p.unit == parameter.unit for p in parameters]
                sizes.append(CHANGE * (one or max(compress(away, units))))
            values += own
            low += [p.low for p in parameters]
            high += [p.high for p in parameters]
        self.values = np.array(values, float)  # of the effects, in a row, (P,)
        self.sizes = np.array(sizes)  # by how much each is changed for its sensitivity, (P,)
        self.ends = np.array(low), np.array(high)  # the least and the largest values, (P,) each

    def predicted(self, values: np.ndarray) -> list[np.ndarray]:
        """Return what encoders tell of each motion (T M,), and of the past (S,), in noises."""
        asked, left = self.asked, iter(values.tolist())
        fixed = [(effect, tuple(islice(left, len(own)))) for effect, own in self.fixed]
        columns, noise = list(asked.noise), np.array(list(asked.noise.values()))
        effects = merge_effects(asked.fixed, fixed)
        made = trial(asked.changed or asked.spec, self.motions, fixed=effects)
        past = trial(asked.spec, asked.past, fixed=effects)
        new, old = ([(p[:, columns] / noise).ravel() for p in paths] for paths in (made, past))
        return [*new, np.concatenate([np.zeros(0), *old])]

    def slopes(self, values: np.ndarray, made: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return how the predictions `made` change with the values, (T M, P) and (S, P).

        Values are changed upwards, else downwards; 0 where both leave a value's range.
        """
        low, high = self.ends
        down = np.where(values - self.sizes >= low, -self.sizes, 0.0)
        steps = np.where(values + self.sizes <= high, self.sizes, down)
        slopes = [np.zeros((len(one), len(values))) for one in made]
        for place in np.flatnonzero(steps):
            changed = self.predicted(values + steps * (np.arange(len(values)) == place))
            for slope, one, other in zip(slopes, changed, made, strict=True):
                slope[:, place] = (one - other) / steps[place]
        return slopes


_View = tuple[list[np.ndarray], list[np.ndarray]]  # predictions and their slopes


def _left(k: int, motion: Recording, view: _View, other: _View) -> float:
    """Return what a linear refit leaves of another explanation's motion k."""
    (made, slopes), (wanted, _) = view, other
    off = np.concatenate([wanted[k] - made[k], wanted[-1] - made[-1]])
    slope = np.concatenate([slopes[k], slopes[-1]])
    if not (np.isfinite(off).all() and np.isfinite(slope).all()):
        return np.nan
    step = np.linalg.lstsq(slope, off, rcond=None)[0]
    return _size((off - slope @ step)[: len(made[k])], motion)


def _settled(motion: Recording, robot: _Model, member: _Model) -> float:
    """Return what is left of a robot's motion once a member has refitted, in noise floors."""
    wanted = robot.predicted(robot.values)

    def off(values: np.ndarray) -> np.ndarray:
        return np.concatenate(member.predicted(values)) - np.concatenate(wanted)

    def slopes(values: np.ndarray) -> np.ndarray:
        return np.nan_to_num(np.concatenate(member.slopes(values, member.predicted(values))))

    error = off(member.values)
    if np.isfinite(error).all():
        limits = {"bounds": member.ends, "x_scale": member.sizes, "max_nfev": TURNS}
        error = least_squares(off, member.values, jac=slopes, **limits).fun  # type: ignore[arg-type]
    return _size(error[: len(wanted[0])], motion)


def _size(noises: np.ndarray, motion: Recording) -> float:
    """Return the distance, root mean square over time, summed over joints."""
    return float(np.sqrt((noises**2).sum() / len(motion.time)))
