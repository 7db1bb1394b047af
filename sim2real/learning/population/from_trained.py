"""A trained policy as a population: many candidates around it, each on its own robot.

    population = population_of(trained, num_rows=256)
    evaluate_adaptation(population, trained.theta, None, adapt, values, seeds, episodes=5)

Whatever trained the policy, its actor's parameters are one vector, which every operator adapts. The
world is that of training with its statistics frozen, so that the same parameters get the same
returns as in `TrainedPolicy.run_episodes`.
"""

from sim2real.learning.population.actors import ActorPolicy
from sim2real.learning.population.env_rows import EnvRows
from sim2real.learning.population.population import Population
from sim2real.learning.trained import TrainedPolicy


def population_of(trained: TrainedPolicy, num_rows: int, critic: bool = False) -> Population:
    """Make a population of a trained policy's actor.

    Args:
        trained: the policy.
        num_rows: episodes that run side by side.
        critic: whether the critic's parameters stand behind the actor's.

    Raises:
        Sim2RealError: a policy that sees more than one vector, such as images, or a world whose
            episodes depend on more than robot, seed and actions; see `ActorPolicy` and `EnvRows`.
    """
    env = trained.make_env(num_rows)
    module = None if trained.critic is None else trained.critic.module
    policy = ActorPolicy(trained.actor(trained.theta), env, critic=module, searched=critic)
    return Population([EnvRows(env)], policy)
