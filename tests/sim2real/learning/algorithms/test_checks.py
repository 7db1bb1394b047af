"""Numbers that no algorithm can learn with are refused with key, value and range."""

import re
from functools import partial
from pathlib import Path

import pytest
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build
from sim2real.learning.algorithms.checks import check_part
from sim2real.runs.errors import Sim2RealError


@pytest.mark.parametrize("algorithm", ["ppo", "ppo_sb3", "trpo"])
@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        ("advantage.gamma=-2", "between 0 and 1"),
        ("advantage.gamma=1.5", "between 0 and 1"),
        ("advantage.lmbda=3", "between 0 and 1"),
        ("loss.critic_coeff=-0.5", "at least 0"),
        ("optimizer.lr=0", "above 0"),
    ],
)
def test_a_part_s_number_out_of_range_is_refused(algorithm: str, given: str, allowed: str) -> None:
    """TorchRL and torch take these; they are refused where parts are put together."""
    with pytest.raises(Sim2RealError, match=rf"{re.escape(given)}(\.0)? must be {allowed}"):
        instantiate(compose([f"algorithm={algorithm}", given]), Path())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["algorithm=ppo", "loss.clip_epsilon=-1"], "loss.clip_epsilon=-1.* above 0"),
        (["algorithm=ppo", "loss.entropy_coeff=-0.1"], "loss.entropy_coeff=-0.1.* at least 0"),
        (
            ["algorithm=ppo", "loss=clip_ppo_compiled", "loss.loss.clip_epsilon=0"],
            r"loss\.loss\.clip_epsilon=0.* above 0",
        ),
        (["algorithm=sac", "loss.alpha_init=0"], "loss.alpha_init=0.* above 0"),
        (["algorithm=ppo", "algorithm.max_grad_norm=0"], "algorithm.max_grad_norm=0.* above 0"),
        (["algorithm=ppo", "algorithm.target_kl=-1"], "algorithm.target_kl=-1.* above 0"),
        (["algorithm=ppo", "algorithm.anneal_frames=0"], "algorithm.anneal_frames=0.* above 0"),
        (["algorithm=trpo", "algorithm.step.max_kl=0"], "step: max_kl=0.* above 0"),
        (["algorithm=sac", "algorithm.tau=2"], "algorithm.tau=2.* between 0 and 1"),
        (["algorithm=sac", "algorithm.warmup_frames=-1"], "warmup_frames=-1 .* at least 0"),
        (["algorithm.sigma=0"], "algorithm.sigma=0.* above 0"),
        (["algorithm.learning_rate=0"], "algorithm.learning_rate=0.* above 0"),
        (["algorithm.weight_decay=-1"], "algorithm.weight_decay=-1.* at least 0"),
    ],
)
def test_a_number_of_an_algorithm_out_of_range_is_refused(words: list[str], sentence: str) -> None:
    """Each before an environment is made, with key, value and range."""
    with pytest.raises(Sim2RealError, match=sentence):
        _, given = instantiate(compose([*words, "env=hopper"]), Path())
        build(given["algorithm"], given["parts"])


def test_what_holds_no_number_is_left_alone() -> None:
    """Limits are allowed, and so is a function, a schedule, or a number of another part."""
    check_part("advantage", partial(GAE, gamma=1.0, lmbda=0))
    check_part("loss", partial(ClipPPOLoss, entropy_coeff={"head": 0.1}, gamma=2.0))
    check_part("loss", lambda actor, critic: None)
    check_part("optimizer", None)
