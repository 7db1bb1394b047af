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
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from envs.effects import Effect
from hardware.log import Log
from sim2real.diagnosis.closed_loop.measured import Episode, episodes_of, histories, shared
from sim2real.diagnosis.contract.logged import place_of
from sim2real.diagnosis.schema import ClosedLoop, ClosedLoopVerdict, Distance, Estimate, Returns
from sim2real.diagnosis.settings import ClosedLoopSettings
from sim2real.runs.distances import TINY, PooledSamples, standardize
from sim2real.runs.errors import Sim2RealError

FEW = 2  # episodes of a robot, below which it has no distance from itself
TRACKED = "sensor.position_0"
ENDS = (5.0, 95.0)  # percentiles of a 90 % interval


class Drawn(NamedTuple):
    """An effect, its values, and the interval from which the first one is drawn, if there is one.

    Args:
        effect: the effect.
        values: of its parameters.
        ci: the 90 % interval of the first.
    """

    effect: Effect
    values: tuple[float, ...]
    ci: tuple[float, float] | None


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
    settings: ClosedLoopSettings,
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
    named = {place_of(log, "policy") for log in logs} - {None}
    if load_player is None or not (actor or named):
        return None
    if actor is None and len(named) > 1:
        policies = ", ".join(sorted(map(str, named)))
        raise Sim2RealError(
            f"the logs belong to several policies ({policies}); diagnose one policy at a time"
        )
    own = [log for log in logs if "action.0" in log.columns] or list(logs)
    if actor is None:
        own = [log for log in logs if place_of(log, "policy")]
    tasks = {str(log.meta["task"]) for log in own if log.meta.get("task")}
    player = load_player(actor or named.pop() or "", tasks.pop() if len(tasks) == 1 else None)
    return check_closed_loop(own, player, effects, seed, settings)


def check_closed_loop(
    logs: Sequence[Log],
    player: Player,
    effects: Sequence[Drawn],
    seed: int,
    settings: ClosedLoopSettings,
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
    robot = episodes_of(logs)
    known = not player.needs_tracker or all(TRACKED in log.columns for log in logs)
    if not known:
        robot = [one._replace(returned=None) for one in robot]
    _refuse(robot, player, settings)
    longest = max(len(next(iter(one.columns.values()))) for one in robot)
    worlds = [player((), settings.episodes, seed)]
    if effects:
        worlds.append(player(effects, settings.episodes, seed))
    worlds = [[_cut(one, longest) for one in world] for world in worlds]
    every = [*robot, *(one for world in worlds for one in world)]
    names = shared(every)
    if not names:
        raise Sim2RealError("the log and the policy's simulator have no channel in common")
    rng = np.random.default_rng(seed)
    distances = _distances(every, len(robot), names, bool(effects), rng, settings)
    return ClosedLoop(
        player.name,
        tuple(names),
        len(robot),
        settings.episodes,
        _verdict(distances[0], settings),
        distances,
        _returns(robot, worlds, rng, settings),
    )


def _refuse(robot: Sequence[Episode], player: Player, settings: ClosedLoopSettings) -> None:
    if len(robot) < FEW:
        raise Sim2RealError(
            f"the policy's logs contain {len(robot)} episode; the robot's distance from itself "
            f"needs "
            f"at least {FEW}: record more episodes of the policy"
        )
    step = float(np.median([one.step for one in robot]))
    if abs(step / player.step - 1) > settings.rate_error:
        raise Sim2RealError(
            f"the log has a row every {step:.4g} s, and the policy {player.name} acts every "
            f"{player.step:.4g} s; give the policy that ran during the recording"
        )


def _cut(one: Episode, rows: int) -> Episode:
    """Return an episode no longer than the robot's."""
    return one._replace(columns={name: values[:rows] for name, values in one.columns.items()})


def _distances(
    every: Sequence[Episode],
    own: int,
    names: Sequence[str],
    corrected: bool,
    rng: np.random.Generator,
    settings: ClosedLoopSettings,
) -> tuple[Distance, ...]:
    """Return both distances of the robot's `own` first episodes from themselves and the rest."""
    samples, group = histories(every, names, settings)
    real = samples[group < own]
    moved = real.std(axis=0) > TINY
    pool = PooledSamples(
        standardize(real[:, moved], samples[:, moved]), group, rng, settings.directions
    )
    half, count = own // 2, len(every)
    rows: dict[str, list[list[float]]] = {"sliced_wasserstein": [], "mmd": []}
    for _ in range(settings.draws):
        dealt = rng.permutation(own)
        others = [dealt[half : 2 * half]]
        for world in range(1 + corrected):
            start = own + world * settings.episodes
            others.append(start + rng.choice(settings.episodes, half, replace=False))
        first = _weights(dealt[:half], count)
        for name, distance in (("sliced_wasserstein", pool.wasserstein), ("mmd", pool.mmd)):
            rows[name].append([distance(first, _weights(other, count)) for other in others])
    return tuple(_distance(name, np.array(values)) for name, values in rows.items())


def _weights(chosen: np.ndarray, count: int) -> np.ndarray:
    """Return 1 for the chosen of so many episodes and 0 for the others."""
    found = np.zeros(count)
    found[chosen] = 1.0
    return found


def _distance(measure: str, values: np.ndarray) -> Distance:
    """Return the means and intervals of draws, (draws, 2 or 3)."""
    ends = [_interval(column) for column in values.T]
    if values.shape[1] <= FEW:
        return Distance(measure, ends[0], ends[1], None, None)
    return Distance(measure, ends[0], ends[1], ends[2], _interval(values[:, 1] - values[:, 2]))


def _interval(values: np.ndarray) -> Estimate:
    low, high = np.percentile(values, ENDS)
    return Estimate(float(values.mean()), (float(low), float(high)))


def _verdict(one: Distance, settings: ClosedLoopSettings) -> ClosedLoopVerdict:
    """Return what a sliced Wasserstein distance says of the last simulator that played."""
    last = one.nominal if one.corrected is None else one.corrected
    if last.value <= max(one.floor.ci[1], settings.negligible):
        return "within_floor"
    if one.nearer is None:
        return "apart"
    if one.nearer.ci[0] > 0:
        return "nearer"
    return "farther" if one.nearer.ci[1] < 0 else "as_far"


def _returns(
    robot: Sequence[Episode],
    worlds: Sequence[Sequence[Episode]],
    rng: np.random.Generator,
    settings: ClosedLoopSettings,
) -> Returns | None:
    """Return what the task paid on the robot and in the simulators; None where nobody knows."""
    paid = [[one.returned for one in world] for world in (robot, *worlds)]
    if any(value is None for world in paid for value in world):
        return None
    means = [_mean(np.array(world, float), rng, settings.draws) for world in paid]
    return Returns(means[0], means[1], means[2] if worlds[1:] else None)


def _mean(values: np.ndarray, rng: np.random.Generator, draws: int) -> Estimate:
    """Return a mean of episodes and its interval, by a bootstrap over them."""
    again = values[rng.integers(len(values), size=(draws, len(values)))].mean(axis=1)
    return replace(_interval(again), value=float(values.mean()))
