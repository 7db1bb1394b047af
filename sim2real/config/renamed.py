"""Renamed keys and removed verbs: an error message names the new one."""

import re
from collections.abc import Sequence

RENAMED = {
    "algorithm.adam_eps": "optimizer.eps",
    "algorithm.alpha": "loss.alpha_init",
    "algorithm.buffer_size": "buffer.storage.max_size",
    "algorithm.clip_epsilon": "loss.clip_epsilon",
    "algorithm.critic_coeff": "loss.critic_coeff",
    "algorithm.entropy_coeff": "loss.entropy_coeff",
    "algorithm.gamma": "advantage.gamma",
    "algorithm.learning_rate": "optimizer.lr",
    "algorithm.lmbda": "advantage.lmbda",
    "algorithm.normalize_advantage": "loss.normalize_advantage",
    "algorithm.normalize_observations": "transforms.observation_norm (transforms=normalized)",
    "algorithm.normalize_rewards": "transforms.reward_scaling (transforms=normalized)",
    "algorithm.target_entropy": "loss.target_entropy",
    "env.frames": "transforms.stack.N",
    "env.grey": "transforms=pixels, or transforms=colour",
    "policy.activation": "policy.actor.activation_class and policy.critic.activation_class",
    "policy.hidden": "policy.actor.num_cells and policy.critic.num_cells",
    "policy.memory": "policy.memory.hidden_size",
    "policy.size": "env.size",
}
OF_DRAW = re.compile(r"(params\.draws\.\d+)\.effect(\.\w+)")  # a draw's effect had keys of its own

MOVED_TARGETS = {  # classes of saved runs' config.yaml
    "sim2real.evaluation.films.Video": "sim2real.evaluation.videos.Video",
    "sim2real.identification.episodes.Finder": "sim2real.identification.episodes.EpisodeIdentifier",
    "sim2real.learning.adapt.Noisy": "sim2real.learning.adapt.NoisyReturns",
    "sim2real.learning.modules.policies.actor_critic": (
        "sim2real.learning.modules.actor_critic.actor_critic"
    ),
    "sim2real.learning.modules.policy.mlp_policy": (
        "sim2real.learning.modules.mlp_policy.mlp_policy"
    ),
    "sim2real.learning.told.WithParams": "sim2real.learning.context.AppendContext",
    "sim2real.runs.loggers.OfTorchRL": "sim2real.runs.loggers.TorchRLLogger",
}


def current_target(target: str) -> str:
    """Return the present name of a class that a saved configuration may call by an older one."""
    return MOVED_TARGETS.get(target, target)


def renamed_key_hint(key: str) -> str:
    """Return " (it is now ...)" for an old key, "" for any other."""
    new = RENAMED.get(key) or (OF_DRAW.sub(r"\1\2", key) if OF_DRAW.fullmatch(key) else None)
    return f" (it is now {new})" if new else ""


ENDED = {  # verbs, and experiments of their name
    "bayrn": "type sim2real improve by=returns +experiment=udr +env@target=TASK (or robot=NAME)",
    "close_loop": "type sim2real improve RUN +env@target=TASK, which also trains on",
    "garat": "GARAT was a baseline of EASI's study alone; identify=easi finds a distribution of "
    "simulators from the same demonstrations: sim2real identify LOG.csv MODEL.xml identify=easi "
    "checkpoint=RUN",
    "relearn": "type sim2real improve RUN robot=NAME, with RUN the training of the policy",
}


def ended(arguments: Sequence[str]) -> str | None:
    """Return a sentence with the replacement of a removed verb; None if none was typed."""
    words = [word.removeprefix("run=").removeprefix("+experiment=") for word in arguments]
    bare = next((word for word in arguments if not word.startswith("-")), None)
    for word, typed in zip(words, arguments, strict=True):
        if word in ENDED and (word != typed or typed == bare):
            return f"{word} has ended: {ENDED[word]}"
    return None
