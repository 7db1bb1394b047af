"""Train on a world of another library, here Gymnasium's pendulum: PPO by its usual parts.

python examples/train_elsewhere.py [ID PACKAGE]    # such as AdroitHandDoor-v1 gymnasium_robotics
"""

from __future__ import annotations

import sys
from pathlib import Path

from sim2real import compose
from sim2real.config.compose import instantiate

SIZE = ["algorithm.num_rows=8", "algorithm.steps=200", "algorithm.minibatch_size=200"]


def main(id: str = "Pendulum-v1", package: str = "null") -> None:
    """Train for ten iterations; metrics, policy and plot are in outputs/elsewhere."""
    env = ["env=gymnasium", f"env.id={id}", f"env.package={package}"]
    config = compose(["algorithm=ppo", *env, *SIZE, "iterations=10"])
    verb, arguments = instantiate(config, Path("outputs", "elsewhere"))
    verb(**arguments)


if __name__ == "__main__":
    main(*sys.argv[1:])
