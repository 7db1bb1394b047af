"""The job that all speed rows do: Hopper with randomized physics under one 64 x 64 tanh policy.

    policy = make_policy()
    theta = hopping(policy)             # a parameter vector of that network
    network(policy, theta)              # the same function as a plain torch module

Two policies bracket what training sees: `fresh`, as a training starts, which falls within some
twenty steps, so that resets are frequent; and `hopping`, which seldom falls within the 1000 steps
and has its foot on the ground half of the time, so that contacts are.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import torch
from torch import nn

from benchmarks.workers import torch_network
from envs.effects import make
from envs.randomization import Draw, Randomization
from envs.simulation import Simulation
from envs.tasks import Hopper
from sim2real.learning.modules.mlp_policy import MLPPolicy
from sim2real.learning.modules.normalizer import Normalizer

POLICY_FILE = Path(__file__).with_name("hopper_policy.json")
THREADS = 2  # of the physics, and worker processes where they take its place
WIDTH = 64  # of both hidden layers
LINEAR = 0.3  # typical input of the hidden units of `hopping`: tanh is nearly linear there

Gait = Literal["hopping", "fresh"]
Simulated = TypeVar("Simulated", bound=Simulation)


def make_tasks() -> Randomization:
    """Return the robots: torso mass 1 to 9 kg, ground friction 1.5 to 2.5, for each episode."""
    mass, friction = make("link_mass", where="torso", how="set"), make("ground_friction")
    return Randomization([Draw(mass, low=1.0, high=9.0), Draw(friction, low=1.5, high=2.5)])


def make_simulation(
    num_rows: int, threads: int = THREADS, kind: type[Simulated] = Simulation
) -> Simulated:
    """Return rows of the randomized Hopper."""
    return kind(Hopper(), num_rows, make_tasks().effects, threads)


def make_policy() -> MLPPolicy:
    """Return the network: 11 -> 64 -> 64 -> 3, tanh, its output clipped by the actuators."""
    return MLPPolicy(
        11,
        3,
        -np.ones(3),
        np.ones(3),
        hidden=(WIDTH, WIDTH),
        activation="tanh",
        output="linear",
        initial="normal",
    )


@dataclass(frozen=True)
class Controller:
    """A parameter vector of the network and how observations are normalized for it."""

    policy: MLPPolicy
    theta: np.ndarray  # (P,) float32
    mean: np.ndarray  # (O,)
    std: np.ndarray  # (O,)

    def normalizer(self) -> Normalizer:
        """Return its frozen normalizer, as a population takes it."""
        normalizer = Normalizer(len(self.mean))
        squares = torch.from_numpy(1e6 * self.std**2)
        normalizer.load_state_dict(
            {"count": 1_000_000, "mean": torch.from_numpy(self.mean), "squares": squares}
        )
        return normalizer

    def layers(self) -> tuple[np.ndarray, ...]:
        """Return weights (in, out) and biases (out,) in turn, normalization folded in; float32."""
        pieces = [self.theta[p.start : p.stop].reshape(p.shape) for p in self.policy.pieces]
        first = pieces[0] / self.std[:, None]  # (O, 64)
        bias = pieces[1][0] - self.mean @ first
        rest = [piece[0] if len(piece) == 1 else piece for piece in pieces[2:]]
        return tuple(layer.astype(np.float32) for layer in (first, bias, *rest))

    def network(self) -> nn.Sequential:
        """Return the same function as a plain torch network."""
        return torch_network(self.layers())

    def unfolded(self) -> nn.Sequential:
        """Return the network alone, of normalized observations."""
        plain = Controller(self.policy, self.theta, np.zeros(11), np.ones(11))
        return torch_network(plain.layers())


def controller(gait: Gait) -> Controller:
    """Return the policy of that gait; the same at each call."""
    policy, rng = make_policy(), np.random.default_rng(0)
    if gait == "fresh":
        return Controller(policy, policy.initial(rng), np.zeros(11), np.ones(11))
    data = {
        key: np.array(value)
        for key, value in json.loads(POLICY_FILE.read_text()).items()
        if key != "about"
    }
    return Controller(
        policy, _widened(rng, data["weights"], data["bias"]), data["mean"], data["std"]
    )


def _widened(rng: np.random.Generator, weights: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Return the network that does what a linear policy does where tanh is linear, (P,)."""
    size = len(weights)
    first = np.linalg.qr(rng.standard_normal((WIDTH, size)))[0].T  # (O, 64)
    first = first * LINEAR * np.sqrt(WIDTH / size)
    second = np.linalg.qr(rng.standard_normal((WIDTH, WIDTH)))[0]  # (64, 64)
    last = np.linalg.pinv(first @ second) @ weights  # (64, A)
    flat = (first, np.zeros(WIDTH), second, np.zeros(WIDTH), last, bias)
    return np.concatenate([piece.ravel() for piece in flat]).astype(np.float32)
