"""Running normalization of a batched environment: what is counted, and how often."""

from typing import Any

import torch
from tensordict import TensorDict

from sim2real.config.compose import compose
from sim2real.learning.environment import make_env
from sim2real.learning.transforms import RunningNorm


def test_a_reset_of_one_row_counts_that_row_alone() -> None:
    """Rows that go on were counted when they stepped."""
    env = make_env(compose(["env=hopper", "transforms=normalized"]), num_envs=4)
    chain: Any = env.transform
    norm = next(t for t in chain if isinstance(t, RunningNorm))
    moments = norm.moments["observation"]

    state: Any = env.rand_step(env.reset())
    assert moments.count == 4 + 4
    state = state["next"]
    state["_reset"] = torch.tensor([[False], [True], [False], [False]])
    env.reset(state)

    assert moments.count == 4 + 4 + 1


def test_a_held_normalization_changes_after_so_many_steps_alone() -> None:
    """Held mean and deviation are those of the steps until then; before, entries pass."""
    env = make_env(
        compose(["env=hopper", "transforms=normalized", "transforms.observation_norm.hold=3"]),
        num_envs=4,
    )
    chain: Any = env.transform
    norm = next(t for t in chain if isinstance(t, RunningNorm))
    raw = make_env(compose(["env=hopper", "transforms=none"]), num_envs=4)
    state, plain = env.reset(), raw.reset()
    torch.testing.assert_close(state["observation"], plain["observation"].float())

    shown, seen = [], [plain["observation"]]
    for _ in range(5):
        action = env.rand_action(state)["action"]
        state, plain = (
            e.step(td.set("action", action))["next"] for e, td in ((env, state), (raw, plain))
        )
        shown.append(state["observation"])
        seen.append(plain["observation"])

    rows = torch.cat(seen[:4]).double()  # the reset and three steps
    mean, std = rows.mean(0), rows.std(0, correction=0)
    for step, observation in enumerate(shown, start=1):
        x = seen[step].double()
        expected = x if step < 3 else (x - mean) / std
        torch.testing.assert_close(observation, expected.clamp(-10, 10).float())
    assert norm.moments["observation"].count == 4 * 6


def test_a_state_carries_what_is_applied() -> None:
    """A norm that takes over a state in mid-hold applies the same from there on."""
    norm, other = RunningNorm(hold=2), RunningNorm(hold=2)
    rows = [TensorDict({"observation": torch.randn(4, 3)}, [4]) for _ in range(5)]
    for row in rows[:3]:
        norm._step(row, row.clone())
    other.load_state_dict(norm.state_dict())
    for row in rows[3:]:
        one, two = (n._step(row, row.clone())["observation"] for n in (norm, other))
        assert torch.equal(one, two)
