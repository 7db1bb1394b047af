"""Separate states of torch's global generators, so that two algorithms do not interfere.

randomness = TorchRandomStream(seed=0, device="cpu")
with randomness:
    action = torch.randn(3)             # follows from the seed and what was drawn inside before
"""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import torch
from torchrl.envs.utils import ExplorationType, set_exploration_type

Tensor = torch.Tensor


class TorchRandomStream:
    """A place in torch's streams of random numbers.

    Args:
        seed: where it starts.
        device: whose generator is meant besides the CPU's.
    """

    def __init__(self, seed: int, device: str) -> None:
        self._cuda = torch.device(device).type == "cuda"
        self.state = [torch.Generator().manual_seed(seed).get_state()]
        if self._cuda:
            self.state.append(torch.Generator(device).manual_seed(seed).get_state())
        self._outside: list[Tensor] = []

    def _swap(self, state: list[Tensor]) -> list[Tensor]:
        before = [torch.get_rng_state()] + ([torch.cuda.get_rng_state()] if self._cuda else [])
        torch.set_rng_state(state[0])
        if self._cuda:
            torch.cuda.set_rng_state(state[1])
        return before

    def __enter__(self) -> None:
        self._outside = self._swap(self.state)

    def __exit__(self, *error: object) -> None:
        self.state = self._swap(self._outside)


@contextmanager
def drawn(randomness: TorchRandomStream | None) -> Iterator[None]:
    """Let policies draw their actions from there; None lets them take the means."""
    how = ExplorationType.DETERMINISTIC if randomness is None else ExplorationType.RANDOM
    with set_exploration_type(how), randomness or nullcontext():
        yield
