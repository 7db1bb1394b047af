"""An exported policy on a small computer: NumPy alone, no torch, no TorchRL.

    policy = ExportedPolicy.load("outputs/export/default/2026-11-21_10-00-00")
    task = Quad8(fidelity="servo")                                # envs.tasks needs no torch either
    rows = RobotRows(task, ServoBackend(load_robot(policy.robot), settle=0.5))
    rows.arm()
    observation = rows.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64))
    while not rows.over:
        observation = rows.step(None, policy(observation)).observation
    rows.close()                                                  # parked, torque off

`policy.json` says what the policy sees and does, and holds pairs of observation and action that
`load` computes again; `policy.npz` holds the numbers. Both are data: nothing in them can run.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import HardwareError

SCHEMA = 1
TOLERANCE = 4e-6  # of the actions' range; sums of float32 in another order differ by some 1e-6


class PolicyError(HardwareError):
    """An exported policy cannot be read, or does not compute here what it did when exported."""


class ExportedPolicy:
    """A perceptron from raw observations to actions.

    Args:
        facts: what `policy.json` holds.
        arrays: what `policy.npz` holds: mean, std (O,), low, high (A,), and of layer i
            weight_i (in, out) and bias_i (out,).

    Attributes:
        robot: the robot's name.
        rate: control steps a second.
        joints: the servos, in the order of the task's goals.
        names: what each number of an observation is.
        parameters: which parameters of the robot, to be identified, are the last of these numbers:
            name, unit, how (set, add or scale), low and high of the range that training drew.

    Raises:
        PolicyError: another schema, or numbers that make no perceptron.
    """

    def __init__(self, facts: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        if facts.get("schema") != SCHEMA:
            raise PolicyError(f"policy.json: schema {facts.get('schema')!r}, not {SCHEMA}")
        try:
            self.robot, self.rate = str(facts["robot"]), float(facts["rate"])
            self.joints, self.names = list(facts["joints"]), list(facts["observation"]["names"])
            self.parameters = list(facts.get("parameters", []))
            self._activation, self._squash = facts["activation"], facts["squash"]
            self._golden = facts["golden"]
            self._mean, self._std = arrays["mean"], arrays["std"]
            self.low, self.high = arrays["low"], arrays["high"]
            self._layers = [
                (arrays[f"weight_{i}"], arrays[f"bias_{i}"]) for i in range(int(facts["layers"]))
            ]
        except (KeyError, TypeError, ValueError) as error:
            raise PolicyError(f"policy.json or policy.npz lacks {error}; export it again") from None
        self._check_sizes()

    @classmethod
    def load(cls, folder: str | Path) -> ExportedPolicy:
        """Read a policy, and check that it computes here what it did where it was exported.

        Raises:
            PolicyError: files that are missing, damaged or do not belong together, or numbers that
                come out otherwise.
        """
        folder = Path(folder)
        try:
            facts = json.loads((folder / "policy.json").read_text(encoding="utf-8"))
            digest = hashlib.sha256((folder / "policy.npz").read_bytes()).hexdigest()
            with np.load(folder / "policy.npz", allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
        except (OSError, ValueError, EOFError) as error:
            raise PolicyError(f"{folder}: the exported policy is incomplete ({error})") from None
        if digest != facts.get("sha256", {}).get("policy.npz"):
            raise PolicyError(f"{folder}: policy.npz is not the one that policy.json describes")
        policy = cls(facts, arrays)
        policy.check()
        return policy

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Map raw observations (..., O) to actions (..., A), float64."""
        observation = np.asarray(observation, np.float64)
        if observation.shape[-1:] != self._mean.shape:
            raise PolicyError(
                f"an observation has {self._mean.size} numbers, {', '.join(self.names)}; this one "
                f"has the shape {observation.shape}"
            )
        x = ((observation - self._mean) / self._std).astype(np.float32)
        for i, (weight, bias) in enumerate(self._layers):
            x = x @ weight + bias
            if i < len(self._layers) - 1:
                x = np.tanh(x) if self._activation == "tanh" else np.maximum(x, 0)
        if self._squash == "tanh":
            return (self.high + self.low) / 2 + (self.high - self.low) / 2 * np.tanh(x)
        action = x.astype(np.float64)
        return np.clip(action, self.low, self.high) if self._squash == "clip" else action

    def check(self) -> None:
        """Check the actions of the exported examples.

        Raises:
            PolicyError: an action differs.
        """
        seen = np.array(self._golden["observation"])
        wanted = np.array(self._golden["action"])
        off = np.abs(self(seen) - wanted).max() / max(float(np.abs(wanted).max()), 1.0)
        if not off <= TOLERANCE:
            raise PolicyError(f"actions are off by {off:.2g} from those at export; export it again")

    def _check_sizes(self) -> None:
        sizes = [self._mean.size, *(weight.shape[1] for weight, _ in self._layers)]
        inputs = [weight.shape[0] for weight, _ in self._layers]
        known = self._activation in ("tanh", "relu") and self._squash in ("none", "tanh", "clip")
        if inputs != sizes[:-1] or sizes[-1] != self.low.size or not known:
            raise PolicyError(
                f"policy.npz: layers of {inputs} inputs for {sizes[0]} observations and "
                f"{self.low.size} actions, {self._activation} and {self._squash}, are not a policy"
            )
