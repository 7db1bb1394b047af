"""The rows of members that learn by PPO count alike, and both learn."""

import numpy as np
import pytest
import torch

from benchmarks.rows.members import Members, MembersTorchRL, parts


@pytest.mark.slow
def test_both_rows_count_gradient_steps_of_members() -> None:
    """Four passes over 512 steps in minibatches of 64 are 32 updates of each member."""
    torch.set_num_threads(1)
    together, loop = Members(3), MembersTorchRL(2)
    together.build()
    before = together._learners.thetas
    assert together.run().steps == 3 * 32
    assert (np.abs(together._learners.thetas - before) > 0).any(axis=1).all()
    loop.build()
    start = [p.detach().clone() for p in loop._policy.parameters()]
    assert loop.run().steps == 2 * 32
    pairs = zip(start, loop._policy.parameters(), strict=True)
    assert all(not torch.equal(old, new) for old, new in pairs)


def test_the_rows_have_the_networks_of_the_experiment() -> None:
    """Actor and critic [128, 64], a minibatch of 64, six rounds of 512 steps."""
    adapt, policy = parts()
    assert sum(p.numel() for p in policy.parameters()) == 19847
    assert (adapt.rounds, adapt.steps, adapt.epochs, adapt.minibatch_size) == (6, 512, 4, 64)
