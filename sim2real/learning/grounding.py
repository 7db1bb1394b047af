"""A grounded simulator: actions are changed on their way, so that it moves as the robot does.

    write(path, trained.program(trained.theta))        # a policy that says how actions are changed
    env = TransformedEnv(MujocoEnv(CartPole(), 8), Compose(Ground(path)))

What is added to an action follows from what is seen and the action itself. It corrects a simulator:
`Environment.over` another base, and therefore every evaluation on a named robot and every robot, is
without it.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torch import nn
from torchrl.envs import Transform

from hardware.files import whole_file
from sim2real.learning.modules.arrays import ArrayMLP
from sim2real.runs.errors import Sim2RealError

FILE = "grounding.npz"
ACTIVATIONS = {nn.Tanh: "tanh", nn.ReLU: "relu"}


class Correction:
    """What is added to actions, as plain arrays.

    Args:
        arrays: mean, std (O + A,), low, high (A,), activation, and of layer i weight_i (out, in)
            and bias_i (out,).
    """

    def __init__(self, arrays: dict[str, np.ndarray]) -> None:
        self._mean, self._std = arrays["mean"], arrays["std"]
        self._low, self._high = arrays["low"], arrays["high"]
        count = len([name for name in arrays if name.startswith("weight_")])
        self._layers = [(arrays[f"weight_{i}"], arrays[f"bias_{i}"]) for i in range(count)]
        self._network = ArrayMLP(str(arrays["activation"]))  # type: ignore[arg-type]

    @property
    def sizes(self) -> tuple[int, int]:
        """O and A: numbers of an observation and of an action."""
        return len(self._mean) - len(self._low), len(self._low)

    def __call__(self, observation: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Return what is added to actions (n, A) where this is seen, (n, O); (n, A)."""
        x = (np.hstack([observation, action]) - self._mean) / self._std
        said = self._network.forward(self._layers, x.astype(np.float32))[-1]
        return np.clip(said, self._low, self._high)


def read(path: str | Path) -> Correction:
    """Read what `write` wrote; raises Sim2RealError for a file that is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return Correction({name: file[name] for name in file.files})
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise Sim2RealError(
            f"{path} is no {FILE} ({error}); run=garat writes one into its folder"
        ) from None


def write(path: str | Path, module: Any) -> None:
    """Write a policy of observation and action, a `modules.acting.Actor`, as arrays.

    Raises:
        Sim2RealError: a network that is no perceptron of one nonlinearity, or a squashed policy.
    """
    layers = [one for one in module.network.modules() if not list(one.children())]
    linear = [one for one in layers if isinstance(one, nn.Linear)]
    between = {type(one) for one in layers if not isinstance(one, nn.Linear)}
    if module.squash != "clip" or len(between) > 1 or not between <= set(ACTIVATIONS):
        raise Sim2RealError(
            f"policy: {', '.join(sorted(one.__name__ for one in between))} cannot ground actions; "
            "use policy=actor_critic, whose layers have one nonlinearity, Tanh or ReLU"
        )
    buffers = {name: value.numpy() for name, value in module.named_buffers()}
    names = {"mean": "observation_mean", "std": "observation_std"}
    names |= {"low": "action_low", "high": "action_high"}
    arrays = {name: buffers[own] for name, own in names.items()}
    for i, layer in enumerate(linear):
        arrays[f"weight_{i}"] = layer.weight.detach().numpy()
        arrays[f"bias_{i}"] = layer.bias.detach().numpy()
    word = np.array(ACTIVATIONS[next(iter(between), nn.Tanh)])
    with whole_file(Path(path)) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, activation=word, **arrays)


class Ground(Transform):
    """Changes actions on their way to the simulator; see the module's text.

    It reads "observation" as the policy sees it: put it behind no transform that changes that.

    Args:
        path: a grounding.npz, which `run=garat` writes.

    Raises:
        Sim2RealError: no path, or a file that is missing or damaged; at the first step, one of
            another task.
    """

    corrects_simulator = True

    def __init__(self, path: str | Path | None) -> None:
        if path is None:
            raise Sim2RealError(
                f"transforms.ground.path: give the {FILE} that run=garat wrote for this simulator"
            )
        super().__init__(in_keys_inv=["action"])
        self._correction = read(path)
        self._path = path

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        seen, said = tensordict.get("observation"), tensordict.get("action")
        sizes = seen.shape[-1], said.shape[-1]
        if sizes != self._correction.sizes:
            raise Sim2RealError(
                f"transforms.ground: {self._path} is for {self._correction.sizes[0]} observations "
                f"and {self._correction.sizes[1]} actions, and here there are {sizes[0]} and "
                f"{sizes[1]}; run=garat with this task, and put ground behind no other transform"
            )
        arrays = (one.detach().cpu().numpy().astype(np.float64) for one in (seen, said))
        more = self._correction(*arrays)
        return tensordict.set("action", said + torch.as_tensor(more).to(said))
