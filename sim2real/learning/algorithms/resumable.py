"""What algorithms with a collector and networks share: their checkpoints, exact to the bit."""

from copy import deepcopy
from typing import Any, ClassVar

import torch

from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.algorithms.checks import check_same_policy
from sim2real.learning.algorithms.collecting import ResumableCollector
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.learning.trained import TrainedPolicy

Tensor = torch.Tensor


class CollectingAlgorithm(Algorithm):
    """Learns from the steps of a collector; a subclass makes the attributes.

    Attributes:
        policy: what acts, a module.
        collecting: what gathers experience.
        counts: names of the counts that a checkpoint keeps.
    """

    counts: ClassVar[tuple[str, ...]] = ("frames", "iteration")
    policy: Any
    collecting: ResumableCollector
    _optimizer: torch.optim.Optimizer | None
    _randomness: TorchRandomStream

    @property
    def shape(self) -> dict[str, Any]:
        """The shape of each parameter."""
        return {name: list(p.shape) for name, p in self.policy.named_parameters()}

    def trained(self) -> TrainedPolicy:
        """Return the present actor."""
        return self.collecting.trained(self.policy, self.frames)

    def _networks(self) -> dict[str, Tensor]:
        """Return parameters and buffers by name."""
        return self.policy.state_dict()

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on."""
        made = self._optimizer
        return {
            "policy": self.shape,
            "networks": {name: p.detach().clone() for name, p in self._networks().items()},
            "optimizer": None if made is None else deepcopy(made.state_dict()),
            "collecting": self.collecting.state_dict(),
            "random": [one.clone() for one in self._randomness.state],
            "counts": tuple(getattr(self, name) for name in self.counts),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned.

        Raises:
            CheckpointError: for a state of another policy, other transforms or other rows.
        """
        check_same_policy(state["policy"], self.shape)
        self.collecting.load_state_dict(state["collecting"])
        self._load_networks(state)
        if self._optimizer is not None:
            self._optimizer.load_state_dict(deepcopy(state["optimizer"]))
        self._randomness.state = [one.clone() for one in state["random"]]

    def load_policy(self, state: dict[str, Any]) -> None:
        """Take over the policy alone, to act and not to go on training.

        Raises:
            CheckpointError: for a state of another policy or other transforms.
        """
        check_same_policy(state["policy"], self.shape)
        self.collecting.load_statistics(state["collecting"])
        self._load_networks(state)

    @torch.no_grad()
    def _load_networks(self, state: dict[str, Any]) -> None:
        for name, own in self._networks().items():
            own.copy_(state["networks"][name])
        for name, count in zip(self.counts, state["counts"], strict=True):
            setattr(self, name, count)
