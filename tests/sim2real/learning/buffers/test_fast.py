"""The fast replay buffer against TorchRL's: the same minibatches."""

from functools import partial
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from tensordict import TensorDict
from torchrl import data

from sim2real.learning.buffers.fast import FastReplayBuffer
from sim2real.runs.errors import Sim2RealError


def buffer(kind: type[data.ReplayBuffer], batch: int = 4, **sampler: Any) -> data.ReplayBuffer:
    """Return an empty buffer for 50 samples with a generator of its own."""
    return kind(
        storage=partial(data.LazyTensorStorage, 50),
        sampler=data.SamplerWithoutReplacement(**sampler),
        batch_size=batch,
        generator=torch.Generator().manual_seed(0),
    )


def samples(count: int, start: int) -> TensorDict:
    """Return samples that are all different, nested entries included."""
    number = torch.arange(start, start + count)
    return TensorDict({"a": number, "next": {"b": number[:, None].float()}}, [count])


@settings(max_examples=40, deadline=None)
@given(
    counts=st.lists(st.integers(6, 50), min_size=1, max_size=3),
    batch=st.integers(1, 6),
    drop_last=st.booleans(),
    shuffle=st.booleans(),
    stop=st.integers(1, 4),
)
def test_it_yields_what_replay_buffer_yields(counts, batch, drop_last, shuffle, stop) -> None:
    """Over epochs, an epoch that is broken off, and new samples: the same, in the same order."""
    found = []
    for kind in (FastReplayBuffer, data.ReplayBuffer):
        one = buffer(kind, batch, drop_last=drop_last, shuffle=shuffle)
        got: list[TensorDict] = []
        for number, count in enumerate(counts):
            one.extend(samples(count, 100 * number))
            got += list(one)
            got += [minibatch for minibatch, _ in zip(one, range(stop), strict=False)]
            got += list(one)
        found.append(got)
    assert len(found[0]) == len(found[1]) > 0
    for ours, theirs in zip(*found, strict=True):
        assert ours.batch_size == theirs.batch_size
        assert torch.equal(ours["a"], theirs["a"])
        assert torch.equal(ours["next", "b"], theirs["next", "b"])


def test_an_epoch_goes_on_from_a_state() -> None:
    """A buffer that takes over another's state yields what that would have."""
    one, other = buffer(FastReplayBuffer), buffer(FastReplayBuffer)
    one.extend(samples(20, 0))
    epoch = iter(one)
    for _ in range(2):
        next(epoch)
    other.extend(samples(1, 0))
    other.load_state_dict(one.state_dict())
    rest = [minibatch["a"] for minibatch in other]
    assert [x.tolist() for x in rest] == [minibatch["a"].tolist() for minibatch in epoch]
    assert len(rest) == 3


def test_what_it_has_not_is_refused() -> None:
    """Another sampler, storage or size: a sentence that says what is allowed."""
    good: dict[str, Any] = {
        "storage": data.LazyTensorStorage(50),
        "sampler": data.SamplerWithoutReplacement(),
        "batch_size": 4,
    }
    wrong = {
        "sampler RandomSampler; give a SamplerWithout": {"sampler": data.RandomSampler()},
        "storage ListStorage; give a flat LazyTensorStorage": {"storage": data.ListStorage(50)},
        "prefetch=2": {"prefetch": 2},
        "batch_size=None; give a number": {"batch_size": None},
    }
    for sentence, change in wrong.items():
        with pytest.raises(Sim2RealError, match=sentence):
            FastReplayBuffer(**(good | change))
    with pytest.raises(Sim2RealError, match="0 samples are fewer than a minibatch of 4"):
        list(FastReplayBuffer(**good))
