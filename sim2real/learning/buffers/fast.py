"""TorchRL's replay buffer, faster where an epoch goes through all samples once.

    buffer = FastReplayBuffer(
        storage=LazyTensorStorage(2048), sampler=SamplerWithoutReplacement(), batch_size=64
    )
    buffer.extend(samples)
    for minibatch in buffer:                          # those that ReplayBuffer yields, in its order
        ...

An epoch's samples are put into their order once; minibatches are slices of that. `ReplayBuffer`
gathers every entry of every minibatch by itself. What is written while an epoch goes on is seen in
the next one.
"""

from collections.abc import Iterator
from typing import Any

from tensordict import TensorDictBase
from torchrl.data import ReplayBuffer, SamplerWithoutReplacement, TensorStorage

from sim2real.runs.errors import Sim2RealError


class FastReplayBuffer(ReplayBuffer):
    """`ReplayBuffer` over tensors with a sampler without replacement.

    Args:
        options: those of `ReplayBuffer`: a storage of tensors with one dimension, a
            `SamplerWithoutReplacement` and a batch size among them; no transform, no prefetching.

    Raises:
        Sim2RealError: for options that it does not have; `ReplayBuffer` takes those.
    """

    def __init__(self, **options: Any) -> None:
        for name in ("transform", "prefetch", "collate_fn", "sample_unit"):
            if options.get(name):
                _refuse(f"{name}={options[name]!r}", f"no {name}")
        if not options.get("batch_size"):
            _refuse(f"batch_size={options.get('batch_size')!r}", "a number above 0")
        super().__init__(**options)
        if type(self.sampler) is not SamplerWithoutReplacement:
            _refuse(f"sampler {type(self.sampler).__name__}", "a SamplerWithoutReplacement")
        if not isinstance(self.storage, TensorStorage) or self.storage.ndim != 1:
            _refuse(f"storage {type(self.storage).__name__}", "a flat LazyTensorStorage")

    def __iter__(self) -> Iterator[TensorDictBase]:
        """Yield the minibatches that are left of the sampler's order."""
        count, size = len(self), self.batch_size
        sampler: Any = self.sampler
        storage: Any = self.storage
        assert size is not None
        sampler.ran_out = False
        if not sampler.can_sample(storage, size):
            raise Sim2RealError(f"buffer: {count} samples are fewer than a minibatch of {size}")
        if sampler.len_storage != count or sampler._sample_list is None:
            sampler._get_sample_list(storage, count, size)
            sampler.len_storage = count
        whole = storage.get(sampler._sample_list)
        for minibatch in whole.split(size):
            sampler._single_sample(count, size)
            yield minibatch
            if sampler.ran_out:
                return


def _refuse(what: str, allowed: str) -> None:
    raise Sim2RealError(f"buffer=fast cannot use {what}; give {allowed}, or buffer=replay")
