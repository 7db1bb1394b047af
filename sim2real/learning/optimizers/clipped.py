"""The other step of PG-MAML: gradient steps on a clipped objective, as ProMP takes them."""

from dataclasses import dataclass

from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True, kw_only=True)
class ClippedSteps:
    """Gradient steps of the optimizer on one iteration's experience (Rothfuss et al. 2019).

    Raises:
        Sim2RealError: for values out of range.
    """

    epochs: int  # steps
    clip_epsilon: float  # how far a ratio of probabilities may leave 1
    kl_weight: float  # weight of the divergence of the policy before adaptation

    def __post_init__(self) -> None:
        if self.epochs < 1 or not 0 < self.clip_epsilon < 1 or not self.kl_weight >= 0:
            raise Sim2RealError(
                f"algorithm.step: epochs={self.epochs} must be at least 1, "
                f"clip_epsilon={self.clip_epsilon} between 0 and 1, kl_weight={self.kl_weight} at "
                "least 0"
            )
