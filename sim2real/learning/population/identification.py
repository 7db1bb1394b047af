"""Score a policy that is conditioned on identified parameters, on many robots at once.

    scores = score_identification(trained, adapt, values, seeds, episodes=5)
    scores.before, scores.after                     # (n, 5) returns each

The counterpart of `evaluate_adaptation`, whose episodes report returns alone. Before, the policy
receives the centre of the training ranges; after, what was found in the logs of the adaptation.
"""

import numpy as np

from envs.simulation import Simulation
from sim2real.learning.adapt.identify import Identify, IdentifySession
from sim2real.learning.population.population import AdaptationScores, draw_seeds
from sim2real.learning.population.recording import RecordedEpisodes, record
from sim2real.learning.trained import TrainedPolicy


def identify_many(
    trained: TrainedPolicy,
    adapt: Identify,
    values: np.ndarray,
    seeds: np.ndarray,
    episodes: int = 0,
) -> tuple[list[IdentifySession], np.ndarray, int]:
    """Let a policy identify robots, side by side.

    Args:
        trained: a policy that receives its robot's parameters.
        adapt: how, of the policy's environment.
        values: the robots, (n, P).
        seeds: of all randomness, (n,) uint64.
        episodes: further seeds that are drawn, for fresh episodes afterwards.

    Returns:
        Each robot's session, the further seeds (n, episodes), and the steps that it took.
    """
    rngs = [np.random.default_rng(int(seed)) for seed in seeds]
    sessions = [adapt.start(trained.theta, rng) for rng in rngs]
    luck = np.stack([draw_seeds(rng, adapt.episodes + episodes) for rng in rngs])
    robot, steps = trained.environment.base_rows(len(values)), 0
    for number in range(adapt.episodes):
        said = _said(trained, [session.ask() for session in sessions])
        played = _played(trained, robot, said, luck[:, number], values)
        steps += int(played.lengths.sum())
        logs = played.log.episodes()
        for session, value, log in zip(sessions, played.returns, logs, strict=True):
            session.tell(float(value), log=log)
    return sessions, luck[:, adapt.episodes :], steps


def score_identification(
    trained: TrainedPolicy, adapt: Identify, values: np.ndarray, seeds: np.ndarray, episodes: int
) -> AdaptationScores:
    """Score a policy before and after it identified its robot, on the same fresh episodes.

    Args:
        trained: a policy that receives its robot's parameters.
        adapt: how it identifies them, of the policy's environment.
        values: the robots, (n, P).
        seeds: of all randomness, (n,) uint64.
        episodes: scoring episodes of each kind and robot.
    """
    sessions, fresh, steps = identify_many(trained, adapt, values, seeds, episodes)
    found = _said(trained, [session.result for session in sessions])
    robot, scores = trained.environment.base_rows(len(values)), []
    for said in (np.zeros_like(found), found):
        played = [_played(trained, robot, said, luck, values) for luck in fresh.T]
        scores.append(np.stack([one.returns for one in played], axis=1))  # (n, F)
        steps += sum(int(one.lengths.sum()) for one in played)
    return AdaptationScores(scores[0], scores[1], steps)


def _said(trained: TrainedPolicy, thetas: list[np.ndarray | None]) -> np.ndarray:
    """Return the context that follows the parameters, (n, P)."""
    return np.stack([theta[len(trained.theta) :] for theta in thetas if theta is not None])


def _played(
    trained: TrainedPolicy,
    robot: Simulation,
    said: np.ndarray,
    luck: np.ndarray,
    values: np.ndarray,
) -> RecordedEpisodes:
    pilot = trained.controller(num_rows=len(values), said=said)
    return record(robot, pilot, luck, values)
