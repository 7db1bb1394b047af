"""A trained policy as files for a small computer.

    python -m sim2real run=export checkpoint=outputs/train/quad8_es/2026-11-21_10-00-00

    policy.pt2   torch.export: torch.export.load(path).module() needs torch, nothing of this project
    policy.npz   the same numbers for NumPy: `hardware.exported.ExportedPolicy`
    policy.json  robot, servos, rate, what each observation is, normalizer, limits, origin, pairs of
                 observation and action to check against, hashes of the files, policy_interface

The normalizer is in the program. Before anything is written, all three are compared on a thousand
observations, wild ones among them.
"""

import hashlib
import json
import logging
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from envs.tasks.servo import ServoTask
from hardware.exported import SCHEMA, TOLERANCE, ExportedPolicy
from hardware.files import atomic_write
from sim2real.learning.context import ContextSpec
from sim2real.learning.interface import interface, observation_names, read_interface
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

log = logging.getLogger(__name__)
PAIRS = 8  # of observation and action, kept in policy.json
TRIED = 1000  # observations of the comparison
WILD = 20.0  # standard deviations of every tenth of them
Arrays = dict[str, np.ndarray]


class ExportError(Sim2RealError):
    """A policy cannot be written as asked."""


def export(trained: TrainedPolicy, task: ServoTask, out: Path, rng: np.random.Generator) -> Path:
    """Write a policy's files into a folder, compared before; see the module's text.

    Raises:
        ExportError: a network that is not a perceptron, or programs that do not agree.
    """
    if trained.program is None:
        raise ExportError(
            "the policy is not a function of one observation: it has a memory, observes images, "
            "or has transforms other than a normalization and parameters without products; export "
            "supports policy=linear, mlp, mlp2 and actor_critic"
        )
    module = trained.program(trained.theta).eval()
    arrays, shape = to_arrays(module, task)
    seen = observations(arrays, rng)
    program = export_program(module, seen)
    wanted = evaluate(module, seen)
    golden = {"observation": seen[:PAIRS].tolist(), "action": wanted[:PAIRS].tolist()}
    facts = {**describe(trained, task, arrays), **shape, "golden": golden}
    check_parity(ExportedPolicy(facts, arrays)(seen), wanted, "policy.npz")
    check_parity(evaluate(program.module(), seen), wanted, "policy.pt2")
    out.mkdir(parents=True, exist_ok=True)
    with atomic_write(out / "policy.pt2") as temporary:
        torch.export.save(program, temporary)
    with atomic_write(out / "policy.npz") as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    digests = {
        name: hashlib.sha256((out / name).read_bytes()).hexdigest()
        for name in ("policy.pt2", "policy.npz")
    }
    facts["sha256"] = digests
    write_text(out / "policy.json", json.dumps(facts, indent=1, ensure_ascii=False) + "\n")
    ExportedPolicy.load(out)
    log.info("%s for %s at %g steps a second in %s", facts["task"], facts["robot"],
             facts["rate"], out)  # fmt: skip
    return out


def to_arrays(module: nn.Module, task: ServoTask) -> tuple[Arrays, dict[str, Any]]:
    """Return a policy's numbers as arrays, and what its perceptron is like.

    Raises:
        ExportError: its network has other layers than linear ones between equal nonlinearities.
    """
    network = getattr(module, "network", None)
    layers = list(network) if isinstance(network, nn.Sequential) else []
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    between = {type(layer) for layer in layers if not isinstance(layer, nn.Linear)}
    alternating = [isinstance(layer, nn.Linear) for layer in layers] == [
        i % 2 == 0 for i in range(2 * len(linear) - 1)
    ]
    if not linear or not alternating or not (between <= {nn.Tanh} or between <= {nn.ReLU}):
        found = ", ".join(type(layer).__name__ for layer in layers) or type(module).__name__
        raise ExportError(
            f"the policy's network ({found}) is not a perceptron with one nonlinearity; export "
            f"supports policy=linear, mlp, mlp2 and actor_critic"
        )
    buffers = {name: value.numpy() for name, value in module.named_buffers()}
    low, high = task.action_range(task.spec().compile())
    arrays = {
        "mean": buffers["observation_mean"],
        "std": buffers["observation_std"],
        "low": np.asarray(low, np.float64),
        "high": np.asarray(high, np.float64),
    }
    for i, layer in enumerate(linear):
        arrays[f"weight_{i}"] = layer.weight.detach().numpy().T.copy()
        arrays[f"bias_{i}"] = layer.bias.detach().numpy().copy()
    squash = getattr(module, "squash", "none")
    activation = "relu" if nn.ReLU in between else "tanh"
    return arrays, {"layers": len(linear), "activation": activation, "squash": squash}


def observations(arrays: Arrays, rng: np.random.Generator) -> np.ndarray:
    """Draw observations like those of training, every tenth of them wild, (TRIED, O)."""
    spread = np.where(np.arange(TRIED) % 10 == 9, WILD, 1.0)[:, None]
    noise = rng.standard_normal((TRIED, arrays["mean"].size))
    return arrays["mean"] + spread * arrays["std"] * noise


def export_program(module: nn.Module, seen: np.ndarray) -> torch.export.ExportedProgram:
    """Return the policy as a program for any number of observations (n, O) float64."""
    many = torch.export.Dim("rows", min=1)
    example = torch.from_numpy(seen[:2])
    return torch.export.export(module, (example,), dynamic_shapes=({0: many},))


def evaluate(module: Callable[[torch.Tensor], torch.Tensor], seen: np.ndarray) -> np.ndarray:
    """Return the actions of a torch policy, (n, A) float64."""
    with torch.no_grad():
        return module(torch.from_numpy(seen)).numpy().astype(np.float64)


def check_parity(got: np.ndarray, wanted: np.ndarray, name: str) -> None:
    """Raise ExportError if actions (n, A) differ by more than TOLERANCE of their range."""
    off = float(np.abs(got - wanted).max()) / max(float(np.abs(wanted).max()), 1.0)
    if not off <= TOLERANCE:
        raise ExportError(f"{name} differs from the trained policy by {off:.2g}; not written")


def describe(trained: TrainedPolicy, task: ServoTask, arrays: Arrays) -> dict[str, Any]:
    """Describe a policy for programs that run it elsewhere."""
    model = task.spec().compile()
    machine, context = task.machine, trained.context
    return {
        "schema": SCHEMA,
        "task": type(task).__name__,
        "robot": machine.name,
        "rate": machine.rate,
        "seconds": task.max_steps / machine.rate,
        "trained_on": task.fidelity,
        "joints": [model.actuator(i).name for i in range(model.nu)],
        "goals": {"low": machine.low.tolist(), "high": machine.high.tolist(), "unit": "rad"},
        "observation": {
            "names": [*observation_names(task), *([] if context is None else context.names)],
            "mean": arrays["mean"].tolist(),
            "std": arrays["std"].tolist(),
        },
        "policy_interface": learned_for(trained),
        "parameters": [] if context is None else parameters(context),
        "action": {"low": arrays["low"].tolist(), "high": arrays["high"].tolist()},
        "checkpoint": None if trained.source is None else trained.source.name,
        "frames": trained.frames,
        "versions": {name: metadata.version(name) for name in ("torch", "numpy", "mujoco")},
    }


def learned_for(trained: TrainedPolicy) -> dict[str, Any] | None:
    """Return the interface that a policy was trained for, as its run says or its environment."""
    if trained.source is None:
        return interface(trained.environment)
    return read_interface(trained.source)


def parameters(context: ContextSpec) -> list[dict[str, Any]]:
    """Describe the robot's parameters that follow an observation, in their order.

    They must be identified (`run=identify`) and put there, each in its unit and within the
    range that the policy was trained in.
    """
    return [
        {"name": p.name, "unit": p.unit, "how": p.how, "low": float(low), "high": float(high)}
        for p, low, high in zip(context.parameters, context.low, context.high, strict=True)
    ]
