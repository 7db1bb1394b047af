"""Adaptation operators: how a policy changes in a few episodes on a robot it was not trained on.

    operator = HillClimb(mode="sequential", queries=2, parallel=1, sigma=0.1)
    session = operator.start(theta, rng)
    while (candidate := session.ask()) is not None:
        session.tell(run_one_episode(candidate))        # the episode's return
    adapted = session.result

An operator is a recipe; a `Session` is one robot going through it, episode by episode, and can be
saved in between. A `BatchedSession` is many members going through it side by side, the form in
which populations run; a session is a cohort of one, so both compute the same numbers.
"""

from sim2real.learning.adapt.base import (
    Adaptation,
    BatchedSession,
    EpisodeTrajectory,
    NoAdaptation,
    Session,
)
from sim2real.learning.adapt.gradient import GradientAdaptation
from sim2real.learning.adapt.hillclimb import HillClimb
from sim2real.learning.adapt.identify import Identify, IdentifySession
from sim2real.learning.adapt.latent import LatentSearch
from sim2real.learning.adapt.linear_gae import LinearGAE
from sim2real.learning.adapt.noisy import NoisyReturns
from sim2real.learning.adapt.policy_gradient import PolicyGradient
from sim2real.learning.adapt.ppo import PPOAdaptation

__all__ = [
    "Adaptation",
    "BatchedSession",
    "EpisodeTrajectory",
    "GradientAdaptation",
    "HillClimb",
    "Identify",
    "IdentifySession",
    "LatentSearch",
    "LinearGAE",
    "NoAdaptation",
    "NoisyReturns",
    "PPOAdaptation",
    "PolicyGradient",
    "Session",
]
