"""A worker process that evaluates members one by one in Gymnasium: an ES without this project.

It imports no more than that needs, so that it starts quickly; the parent sends tasks and starting
states.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, NamedTuple

import gymnasium
import mujoco
import numpy as np

if TYPE_CHECKING:
    from torch import nn

Kind = Literal["torch", "numpy"]


class Member(NamedTuple):
    """One episode to run: a policy on a robot from a state."""

    # weights (in, out) and biases (out,) in turn, normalization folded in; float32
    layers: tuple[np.ndarray, ...]
    torso_mass: float  # kg
    friction: float  # of foot and ground
    qpos: np.ndarray  # (nq,)
    qvel: np.ndarray  # (nv,)
    seed: int
    mean: np.ndarray  # (O,) of the observations, frozen


class Outcome(NamedTuple):
    """What an evolution strategy needs of an episode, as `Population` returns it."""

    steps: int
    total: float  # sum of rewards
    sums: np.ndarray  # (O,) of (observation - mean) over the steps
    squares: np.ndarray  # (O,) of its square


class Loop:
    """One environment, and episodes in it."""

    def __init__(self, kind: Kind) -> None:
        self._env = gymnasium.make("Hopper-v5")
        self._act = _torch_policy if kind == "torch" else _numpy_policy
        self._hopper = self._env.unwrapped

    def episode(self, member: Member) -> Outcome:
        """Run an episode."""
        self._change(member)
        self._env.reset(seed=member.seed)
        self._hopper.set_state(member.qpos, member.qvel)  # type: ignore[attr-defined]
        observation = self._hopper._get_obs()  # type: ignore[attr-defined]
        act, steps, total, over = self._act(member.layers), 0, 0.0, False
        sums, squares = np.zeros_like(member.mean), np.zeros_like(member.mean)
        while not over:
            deviation = observation - member.mean
            sums += deviation
            squares += deviation * deviation
            observation, reward, terminated, truncated, _ = self._env.step(act(observation))
            over = terminated or truncated
            total += float(reward)
            steps += 1
        return Outcome(steps, total, sums, squares)

    def _change(self, member: Member) -> None:
        model, data = self._hopper.model, self._hopper.data  # type: ignore[attr-defined]
        model.body("torso").mass = member.torso_mass
        for geom in ("floor", "foot_geom"):
            model.geom(geom).friction[0] = member.friction
        mujoco.mj_setConst(model, data)  # pyright: ignore[reportAttributeAccessIssue]


def _numpy_policy(layers: tuple[np.ndarray, ...]) -> Callable[[np.ndarray], np.ndarray]:
    w1, b1, w2, b2, w3, b3 = layers

    def act(observation: np.ndarray) -> np.ndarray:
        x = np.tanh(observation.astype(np.float32) @ w1 + b1)
        return np.tanh(x @ w2 + b2) @ w3 + b3

    return act


def torch_network(layers: tuple[np.ndarray, ...]) -> nn.Sequential:
    """Return the tanh network of weights (in, out) and biases (out,) in turn."""
    from torch import from_numpy, nn  # the numpy workers do without it

    modules: list[nn.Module] = []
    for weight, bias in zip(layers[::2], layers[1::2], strict=True):
        linear = nn.Linear(*weight.shape)
        linear.load_state_dict({"weight": from_numpy(weight.T.copy()), "bias": from_numpy(bias)})
        modules += [linear, nn.Tanh()]
    return nn.Sequential(*modules[:-1])


def _torch_policy(layers: tuple[np.ndarray, ...]) -> Callable[[np.ndarray], np.ndarray]:
    import torch

    network = torch_network(layers)

    def act(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return network(torch.from_numpy(observation).float()).numpy()

    return act


_loop: Loop | None = None  # a worker's own; pools give their functions no other place for it


def start(kind: Kind) -> None:
    """Make this process a worker."""
    global _loop
    if kind == "torch":
        import torch

        torch.set_num_threads(1)
    _loop = Loop(kind)


def evaluate(member: Member) -> Outcome:
    """Run an episode in this worker."""
    if _loop is None:
        raise RuntimeError("start() this process as a worker first")
    return _loop.episode(member)
