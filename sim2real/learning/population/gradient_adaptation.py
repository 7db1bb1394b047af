"""A trained policy that adapts by a policy gradient: on many robots at once, and what it is worth.

    scores = score_adaptation(trained, adapt, values, seeds, episodes=5)
    scores.before, scores.after                     # (n, 5) returns each

The counterpart of `evaluate_adaptation`, whose episodes report returns alone. Actions are drawn
while the policy adapts, and are the law's means in the episodes that score it.
"""

import numpy as np
import torch
from torch.func import vmap
from torchrl.envs.utils import ExplorationType, set_exploration_type

from sim2real.learning.adapt import PolicyGradient
from sim2real.learning.collectors.by_task import TaskActor
from sim2real.learning.modules.functional_actor import FunctionalActor
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.learning.population.population import AdaptationScores, draw_seeds
from sim2real.learning.population.rollout import run_episodes
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


def adapt_to(
    trained: TrainedPolicy, adapt: PolicyGradient, values: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """Adapt a policy to robots (n, P); return the parameters (n, P) and the steps that it took.

    Args:
        trained: the policy.
        adapt: how.
        values: the robots.
        rng: all randomness follows from it.
    """
    count, each = len(values), adapt.trajectories
    law = FunctionalActor(trained.actor(trained.theta))
    actor = TaskActor(law, count)
    env = trained.make_env(count * each)
    frames, alive, going = [], [], torch.ones(count * each, dtype=torch.bool)
    seeds = draw_seeds(rng, count * each)
    random = TorchRandomStream(int(rng.integers(2**31)), "cpu")
    try:
        with random, torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            now = env.reset(values=np.repeat(values, each, axis=0), seeds=seeds)
            while going.any():
                stepped, now = env.step_and_maybe_reset(actor(now))
                frames.append(stepped)
                alive.append(going)
                going = going & ~stepped["next", "done"][..., 0]
    finally:
        env.close()

    def by_task(key: object) -> Tensor:
        whole = torch.stack([frame.get(key) for frame in frames], 1)  # (n M, T, ...)
        return whole.unflatten(0, (count, each))

    lived = torch.stack(alive, 1).unflatten(0, (count, each))
    reward = by_task(("next", "reward"))[..., 0]
    if not torch.isfinite(reward[lived]).all():
        raise Sim2RealError("adaptation: rewards must be finite numbers")
    experience = adapt.experience(
        [by_task(key) for key in law.in_keys],
        by_task("action"),
        by_task("action_log_prob"),
        reward,
        lived,
    )
    start = law.vector()
    thetas = vmap(lambda one: adapt.step(law, start, one))(experience).detach()
    return thetas.numpy(), int(lived.sum())


def score_adaptation(
    trained: TrainedPolicy,
    adapt: PolicyGradient,
    values: np.ndarray,
    seeds: np.ndarray,
    episodes: int,
) -> AdaptationScores:
    """Score a policy before and after it adapts, on the same episodes, new to the adaptation.

    Args:
        trained: the policy.
        adapt: how it adapts.
        values: the robots, (n, P).
        seeds: of all randomness, (n,) uint64.
        episodes: scoring episodes of each kind and robot.
    """
    rng = np.random.default_rng(seeds)
    thetas, spent = adapt_to(trained, adapt, values, rng)
    fresh, robots = draw_seeds(rng, len(values) * episodes), np.repeat(values, episodes, axis=0)
    actor = TaskActor(FunctionalActor(trained.actor(trained.theta)), len(values))
    env, scores = trained.make_env(len(robots)), []
    try:
        for parameters in (actor.thetas, torch.from_numpy(thetas)):
            actor.thetas = parameters
            played = run_episodes(env, actor, robots, fresh)
            scores.append(played.returns.reshape(len(values), episodes))
            spent += int(played.lengths.sum())
    finally:
        env.close()
    return AdaptationScores(scores[0], scores[1], spent)
