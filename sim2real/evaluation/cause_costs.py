"""The cost of each cause of a gap to a policy.

    causes = read_causes("effects.yaml")
    worth = price(trained, causes, episodes=64, seed=0)
    worth.costs["return"][0]                    # of the first cause: Interval(value, low, high)

The policy stays as it is. It plays the same episodes (starts, noise, values drawn from their
intervals) on robots that have every subset of the causes; of more than five, on those that grow
along drawn orders. A cause's cost is its Shapley value: by how much it lowers the return, averaged
over all orders in which causes could be put right. Costs add up to what all causes cost together.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import yaml

from envs.effects import Effect, load_effects
from envs.effects.base import PLAIN, RULES
from envs.params import ParamSpace
from sim2real.evaluation import shapley
from sim2real.evaluation.shapley import Order, Set
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import Interval, bootstrap, mean

EXACT_MAX = 5  # causes up to which every subset is played: 32 robots
ROWS_MAX = 1024  # episodes side by side
HALF = 1.645  # standard deviations from the middle to the end of a 90 % interval
EPISODES, VALUES, ORDERS, INTERVALS = range(4)  # streams of randomness that follow from one seed
MEASURES = ("return", "fall", "seconds")
SIGNS = {"return": -1.0, "fall": 1.0, "seconds": -1.0}  # of what is a cost
Report = Callable[[int, int], None]


@dataclass(frozen=True)
class Cause:
    """An effect with its values, and how far the first one may be off."""

    effect: Effect
    values: tuple[float, ...]  # of its parameters
    std: float = 0.0  # standard deviation of the first value; 0 where no interval is known
    # its 90 % interval, as the file has it; None where it has none
    ci: tuple[float, float] | None = None

    @property
    def label(self) -> str:
        """Its effect, place and variant."""
        variant = self.effect.variant
        return self.effect.label() + (f" ({variant})" if variant else "")

    @property
    def structural(self) -> bool:
        """Whether it adds to the robot's structure, so that it needs a separate batch."""
        return self.effect.batch() not in (PLAIN, RULES)


class CauseTasks:
    """The causes that the episodes of a batch may have: the tasks of an environment.

    Values come with each episode; a row whose episode is over goes on with a robot without causes.
    """

    per: Literal["reset", "row"] = "reset"

    def __init__(self, effects: Sequence[Effect]) -> None:
        self.effects = tuple(effects)
        self._neutral = np.zeros(0)

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Return n robots without causes, (n, P)."""
        return np.tile(self._neutral, (n, 1))

    def check(self, space: ParamSpace) -> None:
        """Learn what a robot without causes is; any space will do."""
        self._neutral = space.neutral


class Outcome(NamedTuple):
    """Returns, falls and lengths of E episodes."""

    returns: np.ndarray  # (E,)
    falls: np.ndarray  # (E,) 1 where an episode ended before its time
    seconds: np.ndarray  # (E,) that it lasted

    def measure(self, name: str) -> np.ndarray:
        """Return one of `MEASURES`, (E,)."""
        return self[MEASURES.index(name)]


class EffectCost(NamedTuple):
    """The cost of an effect at a value, in addition to all causes."""

    effect: str
    where: str | None
    value: float
    unit: str
    cost: dict[str, Interval]  # by measure: lost return, falls more, seconds less


@dataclass(frozen=True)
class CauseCosts:
    """The costs of all causes."""

    causes: tuple[Cause, ...]  # n of them
    plain: dict[str, Interval]  # what the policy gets without any cause, by measure
    every: dict[str, Interval]  # what it gets with all of them
    # by measure, the Shapley value of each cause: lost return, more falls, fewer seconds
    costs: dict[str, list[Interval]]
    alone: dict[str, list[Interval]]  # by measure, what each costs if it is the only one
    last: dict[str, list[Interval]]  # by measure, what putting each right alone would bring
    # what effects that the logs do not exclude could cost, the dearest first
    open: tuple[EffectCost, ...]
    exact: bool  # whether every subset was played
    episodes: int  # E


def read_causes(path: str | Path) -> list[Cause]:
    """Return the effects of a file with how far their values may be off.

    Args:
        path: an effects.yaml (`ci`: 90 % intervals) or a distribution.yaml (`std`).

    Raises:
        EffectError: see `load_effects`.
        Sim2RealError: a file without effects, or one effect at one place twice.
    """
    given = load_effects(path)
    if not given:
        raise Sim2RealError(f"{path} contains no effects; `worth` needs at least one")
    content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    entries = content.get("entries", []) if isinstance(content, dict) else content
    found = [_cause(one, entry) for one, entry in zip(given, entries, strict=True)]
    labels = [cause.label for cause in found]
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise Sim2RealError(f"{path}: {twice} occurs twice; combine the two values")
    return found


def _cause(given: tuple[Effect, tuple[float, ...]], entry: Mapping[str, Any]) -> Cause:
    effect, values = given
    ci, std = entry.get("ci"), entry.get("std")
    ends = None if ci is None else (float(ci[0]), float(ci[1]))
    if isinstance(std, int | float):
        return Cause(effect, values, float(std), ends)
    return Cause(effect, values, 0.0 if ends is None else (ends[1] - ends[0]) / 2 / HALF, ends)


class CoalitionRollouts:
    """A policy's episodes on robots with any of some causes, with common random numbers.

    Starts, noise and values follow from the seed and are the same for all robots.

    Raises:
        Sim2RealError: a policy whose world simulates no robot, or too few episodes.
    """

    def __init__(
        self, trained: TrainedPolicy, causes: Sequence[Cause], episodes: int, seed: int
    ) -> None:
        if not trained.environment.simulated:
            raise Sim2RealError(
                f"{trained.environment.name} does not simulate a robot that can have effects; "
                f"give a "
                "checkpoint of a robot's task, such as env=quad8 or env=hopper"
            )
        if episodes < 2:
            raise Sim2RealError(f"episodes={episodes}: at least 2 are needed for an interval")
        self.trained, self.causes, self.episodes = trained, tuple(causes), episodes
        self.seeds = draw_seeds(np.random.default_rng([seed, EPISODES]), episodes)
        rng = np.random.default_rng([seed, VALUES])
        self.drawn = rng.standard_normal((episodes, len(self.causes)))  # (E, n)
        task = trained.environment.task
        assert task is not None
        self.seconds = float(task.dt)
        self.steps = task.max_steps

    def play(self, robots: Sequence[Set], report: Report | None = None) -> dict[Set, Outcome]:
        """Play all episodes on each of these robots, those of one structure in one batch."""
        batches: dict[Set, list[Set]] = {}
        for robot in robots:
            structure = frozenset(i for i in robot if self.causes[i].structural)
            batches.setdefault(structure, []).append(robot)
        found: dict[Set, Outcome] = {}
        at_once = max(ROWS_MAX // self.episodes, 1)
        for structure, own in batches.items():
            for start in range(0, len(own), at_once):
                found |= self._batch(structure, own[start : start + at_once])
                if report is not None:
                    report(len(found), len(robots))
        return found

    def with_added(self, one: Cause) -> Outcome:
        """Play a robot that has all causes and another one; at its place it stands for a cause."""
        kept = [i for i, cause in enumerate(self.causes) if cause.label != one.label]
        other = copy(self)
        other.causes = (*(self.causes[i] for i in kept), one)
        other.drawn = np.column_stack([self.drawn[:, kept], np.zeros(self.episodes)])
        (outcome,) = other.play([frozenset(range(len(other.causes)))]).values()
        return outcome

    def _batch(self, structure: Set, robots: Sequence[Set]) -> dict[Set, Outcome]:
        """Play robots of one structure side by side."""
        environment, values = self.robots(structure, robots)
        count = len(robots)
        flat = values.reshape(count * self.episodes, -1)
        played = self.trained.run_episodes(np.tile(self.seeds, count), environment, flat)
        lengths = played.lengths.reshape(count, -1)
        returns = played.returns.reshape(count, -1)
        return {
            robot: Outcome(
                returns[k], (lengths[k] < self.steps).astype(float), lengths[k] * self.seconds
            )
            for k, robot in enumerate(robots)
        }

    def world(self, effects: Sequence[Effect]) -> EnvironmentFactory:
        """Return the policy's world with effects that its robots may have.

        What the policy was trained with stays, but for an effect that is among the causes.
        """
        made = self.trained.environment
        labels = {(c.effect.name, c.effect.where) for c in self.causes}
        fixed = [one for one in made.fixed if (one[0].name, one[0].where) not in labels]
        return replace(made, tasks=CauseTasks(effects), fixed=fixed)

    def robots(
        self, structure: Set, robots: Sequence[Set]
    ) -> tuple[EnvironmentFactory, np.ndarray]:
        """Return the world of S robots, and the values of each in each episode, (S, E, P).

        Args:
            structure: the causes that add to the structure of all of them.
            robots: which causes each has.
        """
        there = [i for i, c in enumerate(self.causes) if not c.structural or i in structure]
        environment = self.world([self.causes[i].effect for i in there])
        space: ParamSpace = environment.base_rows(1, threads=1).space
        values = np.tile(space.neutral, (len(robots), self.episodes, 1))
        start = 0
        for i in there:
            stop = start + len(self.causes[i].values)
            own = self._values(i, space.low[start], space.high[start])  # (E, p)
            for number, robot in enumerate(robots):
                if i in robot:
                    values[number, :, start:stop] = own
            start = stop
        return environment, values

    def _values(self, number: int, low: float, high: float) -> np.ndarray:
        """Return the values of a cause in every episode, (E, p); the first one is drawn."""
        cause = self.causes[number]
        values = np.tile(np.array(cause.values, float), (self.episodes, 1))
        values[:, 0] = np.clip(values[:, 0] + cause.std * self.drawn[:, number], low, high)
        return values


def compute_cause_costs(
    trained: TrainedPolicy,
    causes: Sequence[Cause],
    episodes: int = 64,
    orders: int = 24,
    seed: int = 0,
    excluded: Sequence[Cause] = (),
    resamples: int = 2000,
    report: Report | None = None,
) -> CauseCosts:
    """Say what each cause costs a policy, and what others could cost.

    Args:
        trained: the policy.
        causes: what the robot has, n of them.
        episodes: E on each robot.
        orders: drawn orders where there are more than five causes.
        seed: of all randomness.
        excluded: effects that logs do not exclude, at the ends of their intervals; each is put on
            top of all causes.
        resamples: of each interval, over episodes and the values drawn in them.
        report: called with the robots done and the robots in all.

    Raises:
        Sim2RealError: no causes; see also `CoalitionRollouts`.
        EffectError: an effect that the policy's robot cannot have.
    """
    if not causes:
        raise Sim2RealError("worth needs causes; give effects=PATH")
    count, rng = len(causes), np.random.default_rng([seed, INTERVALS])
    drawn: list[Order] = []
    if count > EXACT_MAX:
        drawn = shapley.sample_permutations(count, orders, np.random.default_rng([seed, ORDERS]))
    robots = shapley.permutation_prefixes(drawn) if drawn else shapley.coalitions(count)
    robots = list(dict.fromkeys([*robots, *_ends(count)]))
    game = CoalitionRollouts(trained, causes, episodes, seed)
    outcomes = game.play(robots, report)
    nothing, everything = frozenset[int](), frozenset(range(count))

    def interval(values: np.ndarray) -> Interval:
        return _interval(values, rng, resamples)

    def got(robot: Set) -> dict[str, Interval]:
        return {name: interval(outcomes[robot].measure(name)) for name in MEASURES}

    costs, alone, last = {}, {}, {}
    for name in MEASURES:
        values = {robot: SIGNS[name] * one.measure(name) for robot, one in outcomes.items()}
        if drawn:
            shares = shapley.marginal_contributions(values, drawn).mean(axis=0)
        else:
            shares = shapley.shapley(values, count)
        costs[name] = [interval(share) for share in shares]
        alone[name] = [interval(values[frozenset({i})] - values[nothing]) for i in range(count)]
        last[name] = [interval(values[everything] - values[everything - {i}]) for i in range(count)]
    open_ = []
    for number, one in enumerate(excluded, 1):
        more = _more(game.with_added(one), outcomes[everything])
        cost = {name: interval(values) for name, values in more.items()}
        effect = one.effect
        open_.append(EffectCost(effect.name, effect.where, one.values[0], effect.unit, cost))
        if report is not None:
            report(len(robots) + number, len(robots) + len(excluded))
    open_.sort(key=lambda one: -one.cost["return"].value)
    rest = (costs, alone, last, tuple(open_), not drawn, episodes)
    return CauseCosts(tuple(causes), got(nothing), got(everything), *rest)


def _interval(values: np.ndarray, rng: np.random.Generator, resamples: int) -> Interval:
    """Return the mean of episodes (E,) and its interval."""
    if not np.ptp(values):  # every episode alike: nothing to resample
        return Interval(*[float(values.mean())] * 3)
    return bootstrap(values[:, None], mean, rng, draws=resamples, resample="rows")


def _more(one: Outcome, other: Outcome) -> dict[str, np.ndarray]:
    """Return the first outcome's excess cost over the other's in each episode, by measure."""
    return {name: SIGNS[name] * (one.measure(name) - other.measure(name)) for name in MEASURES}


def _ends(count: int) -> list[Set]:
    """Return the robots without, with one, with all and with all but one of the causes."""
    every = frozenset(range(count))
    ones = [frozenset({i}) for i in range(count)]
    return [frozenset(), *ones, every, *(every - {i} for i in range(count))]
