"""Is the corrected simulator closer to the robot than the nominal one, once the policy acts?

    player = load_player("outputs/train/quad8_es/…")
    loop = check_closed_loop(logs, player, effects, seed, settings)
    loop.distances[0].corrected, loop.distances[0].floor, loop.verdict

A replay receives the robot's commands. Here the policy computes its own: in the simulator as
given, and with the effects, each episode with values drawn from their intervals. What encoders and
IMU measured is compared as a distribution (`measured`), by sliced Wasserstein distance and maximum
mean discrepancy. The floor is the robot's distance from itself: its episodes are dealt to two
halves. So that all distances have the same bias, each is between one half of the robot's episodes
and as many others; the draws of episodes give the intervals (subsampling, Politis and Romano 1994).
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from envs.effects import Effect
from hardware.log import Log
from sim2real.diagnosis.closed_loop.measured import Episode, episodes_of, histories, shared
from sim2real.diagnosis.contract.logged import place_of
from sim2real.diagnosis.schema import ClosedLoop, ClosedLoopVerdict, Distance, Estimate, Returns
from sim2real.diagnosis.settings import Settings
from sim2real.runs.distances import TINY, PooledSamples, standardize
from sim2real.runs.errors import Sim2RealError

FEW = 2  # episodes of a robot, below which it has no distance from itself
TRACKED = "sensor.position_0"
ENDS = (5.0, 95.0)  # percentiles of a 90 % interval


class Drawn(NamedTuple):
    """An effect, and the values of its parameters in a simulator."""

    effect: Effect
    values: tuple[float, ...]
    ci: tuple[float, float] | None  # 90 % interval from which the first is drawn; None: it is not


class Player(Protocol):
    """A policy that plays in its simulator; `sim2real.loops.player.load_player` makes one."""

    name: str
    step: float  # s of a control step
    needs_tracker: bool  # whether the task pays for where the base is

    def __call__(self, effects: Sequence[Drawn], episodes: int, seed: int) -> list[Episode]:
        """Play episodes in a simulator with effects, values drawn anew in each."""
        ...


LoadPlayer = Callable[[str | Path, str | None], Player]  # a file, and the task that the log names


def closed_loop_of(
    logs: Sequence[Log],
    load_player: LoadPlayer | None,
    actor: str | Path | None,
    effects: Sequence[Drawn],
    seed: int,
    settings: Settings,
) -> ClosedLoop | None:
    """Return the check of the policy that wrote logs; None where none did.

    Args:
        logs: of a robot; recordings without a policy are left out.
        load_player: reads the policy; None checks nothing.
        actor: the policy's file; None for the one that the logs name.
        effects: what the simulator lacks.
        seed: of starts, values and draws.
        settings: how much is played, and how it is compared.

    Raises:
        Sim2RealError: logs of several policies; see `check_closed_loop`.
    """
    if load_player is None:
        return None
    if actor is None:
        logs = [log for log in logs if place_of(log, "policy")]
        policies = sorted({str(place_of(log, "policy")) for log in logs})
        if not policies:
            return None
        if len(policies) > 1:
            raise Sim2RealError(
                f"the logs belong to several policies ({', '.join(policies)}); diagnose one policy "
                "at a time"
            )
        actor = policies[0]
    else:
        logs = [log for log in logs if "action.0" in log.columns] or list(logs)
    tasks = {str(log.meta["task"]) for log in logs if log.meta.get("task")}
    player = load_player(actor, tasks.pop() if len(tasks) == 1 else None)
    return check_closed_loop(logs, player, effects, seed, settings)


def check_closed_loop(
    logs: Sequence[Log],
    player: Player,
    effects: Sequence[Drawn],
    seed: int,
    settings: Settings,
) -> ClosedLoop:
    """Compare what the robot measured with what the policy meets in both simulators.

    Args:
        logs: of the robot, all of one policy.
        player: the policy.
        effects: what the simulator lacks; none compares the simulator as given alone.
        seed: of starts, values and draws.
        settings: how much is played, and how it is compared.

    Raises:
        Sim2RealError: fewer than two episodes, another control rate, or no channel in common.
    """
    robot, limits = episodes_of(logs), settings.closed_loop
    _refuse(robot, player, settings)
    longest = max(len(next(iter(one.columns.values()))) for one in robot)
    known = not player.needs_tracker or all(TRACKED in log.columns for log in logs)
    worlds = [
        [
            one._replace(columns={name: values[:longest] for name, values in one.columns.items()})
            for one in player(some, limits.episodes, seed)
        ]
        for some in ([(), effects] if effects else [()])
    ]
    every = [*robot, *chain(*worlds)]
    names = shared(every)
    if not names:
        raise Sim2RealError("the log and the policy's simulator have no channel in common")
    rng = np.random.default_rng(seed)
    distances = _distances(every, len(robot), names, rng, settings)
    return ClosedLoop(
        player.name,
        tuple(names),
        len(robot),
        limits.episodes,
        _verdict(distances[0], limits.negligible),
        distances,
        _returns([robot, *worlds], rng, settings.bootstrap.draws) if known else None,
    )


def _refuse(robot: Sequence[Episode], player: Player, settings: Settings) -> None:
    if len(robot) < FEW:
        raise Sim2RealError(
            f"the policy's logs contain {len(robot)} episode; the robot's distance from itself "
            f"needs at least {FEW}: record more episodes of the policy"
        )
    step = float(np.median([one.step for one in robot]))
    if abs(step / player.step - 1) > settings.preflight.rate_error:
        raise Sim2RealError(
            f"the log has a row every {step:.4g} s, and the policy {player.name} acts every "
            f"{player.step:.4g} s; give the policy that ran during the recording"
        )


def _distances(
    every: Sequence[Episode],
    own: int,
    names: Sequence[str],
    rng: np.random.Generator,
    settings: Settings,
) -> tuple[Distance, ...]:
    """Return both distances of the robot's `own` first episodes from themselves and the rest."""
    samples, group = histories(every, names, settings.closed_loop)
    real = samples[group < own]
    moved = real.std(axis=0) > TINY
    scaled = standardize(real[:, moved], samples[:, moved])
    pool = PooledSamples(scaled, group, rng)
    half, episodes = own // 2, settings.closed_loop.episodes
    worlds = range(own, len(every), episodes)  # where each begins
    found = []
    for _ in range(settings.bootstrap.draws):
        dealt = rng.permutation(own)
        drawn = [begin + rng.choice(episodes, half, replace=False) for begin in worlds]
        first, *others = (
            np.bincount(chosen, minlength=len(every))
            for chosen in (dealt[:half], dealt[half : 2 * half], *drawn)
        )
        found.append([[pool.wasserstein(first, one), pool.mmd(first, one)] for one in others])
    both = zip(("sliced_wasserstein", "mmd"), np.array(found).transpose(2, 0, 1), strict=True)
    return tuple(_distance(name, values) for name, values in both)


def _distance(measure: str, values: np.ndarray) -> Distance:
    """Return the means and intervals of draws, (draws, 2 or 3)."""
    floor, nominal, *corrected = (_interval(column) for column in values.T)
    if not corrected:
        return Distance(measure, floor, nominal, None, None)
    nearer = _interval(values[:, 1] - values[:, 2])
    return Distance(measure, floor, nominal, corrected[0], nearer)


def _interval(values: np.ndarray) -> Estimate:
    low, high = np.percentile(values, ENDS)
    return Estimate(float(values.mean()), (float(low), float(high)))


def _verdict(one: Distance, negligible: float) -> ClosedLoopVerdict:
    """Return what a sliced Wasserstein distance says of the last simulator that played."""
    last = one.nominal if one.corrected is None else one.corrected
    if last.value <= max(one.floor.ci[1], negligible):
        return "within_floor"
    if one.nearer is None:
        return "apart"
    if one.nearer.ci[0] > 0:
        return "nearer"
    return "farther" if one.nearer.ci[1] < 0 else "as_far"


def _returns(
    worlds: Sequence[Sequence[Episode]], rng: np.random.Generator, draws: int
) -> Returns | None:
    """Return what the task paid on the robot and in the simulators; None where nobody knows.

    Intervals are those of the mean, by a bootstrap over the episodes.
    """
    paid = [[one.returned for one in world] for world in worlds]
    if any(value is None for world in paid for value in world):
        return None
    means = []
    for world in paid:
        values = np.array(world, float)
        again = values[rng.integers(len(values), size=(draws, len(values)))]
        means.append(replace(_interval(again.mean(axis=1)), value=float(values.mean())))
    return Returns(means[0], means[1], means[2] if means[2:] else None)
