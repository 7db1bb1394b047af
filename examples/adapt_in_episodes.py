"""Hill climbing by ask and tell: each reported value may be one episode of a robot.

python examples/adapt_in_episodes.py
"""

from __future__ import annotations

import numpy as np

from sim2real import HillClimb

BEST = np.array([0.3, -0.2, 0.1])  # of the robot that this function stands for


def episode(theta: np.ndarray) -> float:
    """Return what an episode with these parameters (3,) is worth."""
    return float(-np.sum((theta - BEST) ** 2))


def main() -> None:
    """Adapt for thirty episodes and print the return before and after."""
    climb = HillClimb(mode="sequential", queries=30, parallel=1, sigma=0.1, incumbent_episodes=1)
    session = climb.start(np.zeros(3), np.random.default_rng(0))
    while (candidate := session.ask()) is not None:
        session.tell(episode(candidate))
    print(f"before {episode(np.zeros(3)):.3f}, after {episode(session.result):.3f}")


if __name__ == "__main__":
    main()
