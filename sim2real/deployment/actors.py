"""A policy as a function of one observation, from any file that is data alone.

    actor = load_actor("policy.onnx")               # .pt2, policy.npz, a run, a checkpoint
    action = actor(observation)                     # (n, O) to (n, A), float64

Nothing in these files is executed. TorchScript, pickles and other files that could run code are
refused.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from envs.tasks.servo import ServoTask
from sim2real.deployment.program_check import ActorError, check_program
from sim2real.deployment.trained import load_policy
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import Sim2RealError

RUNS_CODE = (".pt", ".pth", ".jit", ".pkl", ".pickle", ".torchscript")
MATRIX = 2  # dimensions of many observations
Function = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class LoadedPolicy:
    """A policy without a memory."""

    function: Function  # raw observations (n, O) to actions (n, A), float64
    size: int | None  # O; None where the file does not say
    task: str | None = None  # class name of the task it was trained on, where it is ours
    normalizer: np.ndarray | None = None  # mean and std (2, O) inside it, where it says them

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Map observations (n, O) to actions (n, A)."""
        return self.function(observation)


def load_actor(path: str | Path) -> LoadedPolicy:
    """Read a policy.

    Args:
        path: an ONNX file, a torch.export archive (.pt2), policy.npz, policy.json or their folder,
            a run's folder or a checkpoint in it.

    Raises:
        Sim2RealError: no such file, one that could execute code, one with a memory, or an extra
            that is missing, with what to install.
    """
    path = Path(path).expanduser()
    if not path.exists():
        raise ActorError(f"{path}: no such policy; give a file or a run's folder")
    if path.suffix in RUNS_CODE:
        raise ActorError(
            f"{path}: a {path.suffix} file can execute code when it is loaded; export the policy "
            "as ONNX, or with torch.export as .pt2"
        )
    if path.suffix == ".onnx":
        return _onnx(path)
    if path.suffix == ".pt2":
        return _program(path)
    folder = path.parent if path.name in ("policy.npz", "policy.json") else path
    if (folder / "policy.json").is_file():
        return _exported(folder)
    return actor_of(load_policy(path), path)


def _exported(folder: Path) -> LoadedPolicy:
    """An export of ours, computed by NumPy."""
    import json

    from hardware.exported import ExportedPolicy

    policy = ExportedPolicy.load(folder)
    facts = json.loads((folder / "policy.json").read_text(encoding="utf-8"))
    seen = facts["observation"]
    normalizer = np.array([seen["mean"], seen["std"]], float)
    return LoadedPolicy(policy, len(policy.names), facts.get("task"), normalizer)


def actor_of(trained: TrainedPolicy, path: str | Path) -> LoadedPolicy:
    """Return a trained policy as a function of one observation.

    Args:
        trained: the policy.
        path: what it is called in an error.

    Raises:
        ActorError: a policy with a memory, or of another kind of task.
    """
    import torch

    task = trained.environment.task
    if trained.program is None or not isinstance(task, ServoTask):
        raise ActorError(
            f"{path}: the policy is not a function of one observation of a servo robot (it has a "
            f"memory, observes images, or belongs to another task), so it cannot be recomputed "
            f"from a log"
        )
    if trained.context is not None:
        raise ActorError(
            f"{path}: the policy receives its robot's parameters "
            f"({', '.join(trained.context.names)}), which logs do not contain, so its actions "
            f"cannot be recomputed from a log"
        )
    module = trained.program(trained.theta).eval()
    low, high = task.action_range(task.spec().compile())
    buffers = {name: value.numpy() for name, value in module.named_buffers()}
    normalizer = np.stack([buffers["observation_mean"], buffers["observation_std"]])

    def function(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            action = module(torch.from_numpy(np.asarray(observation, np.float64)))
        made = action.numpy().astype(np.float64)
        return np.clip(made, low, high) if trained.clips_actions else made

    return LoadedPolicy(function, normalizer.shape[1], type(task).__name__, normalizer)


def _program(path: Path) -> LoadedPolicy:
    """A torch.export archive."""
    import torch

    check_program(path)
    try:
        program = torch.export.load(path)
        inputs = {
            node.name: node.meta["val"] for node in program.graph.nodes if node.op == "placeholder"
        }
        fed = [inputs[name] for name in program.graph_signature.user_inputs]
    except Exception as error:  # whatever torch says of a damaged archive
        raise ActorError(f"{path}: torch cannot read this archive ({error})") from None
    if len(fed) != 1:
        raise ActorError(
            f"{path}: the policy has {len(fed)} inputs; only policies with one input can be "
            f"compared"
        )
    module, like = program.module(check_guards=False), fed[0]
    one_by_one = like.ndim < MATRIX or isinstance(like.shape[0], int)

    def function(observation: np.ndarray) -> np.ndarray:
        given = torch.from_numpy(np.asarray(observation, np.float64)).to(like.dtype)
        with torch.no_grad():
            if not one_by_one:
                return _array(module(given))
            return np.stack([_array(module(row.reshape(like.shape))).reshape(-1) for row in given])

    return LoadedPolicy(function, int(like.shape[-1]))


def _onnx(path: Path) -> LoadedPolicy:
    """An ONNX model, computed by onnxruntime; no operators of other libraries are loaded."""
    if find_spec("onnxruntime") is None:
        raise ActorError(
            f"{path}: an ONNX policy needs onnxruntime; install it with: pip install "
            "'sim2real[onnx]'"
        )
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    try:
        session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # its own classes, one for each kind of damage
        words = " ".join(str(error).split())
        raise ActorError(f"{path}: onnxruntime cannot read this model ({words})") from None
    inputs = session.get_inputs()
    if len(inputs) != 1:
        names = ", ".join(one.name for one in inputs)
        raise ActorError(
            f"{path}: the policy has {len(inputs)} inputs ({names}); only policies with one input "
            f"can be recomputed from a log"
        )
    like, first = inputs[0], session.get_outputs()[0].name
    dtype = np.float64 if "double" in like.type else np.float32
    fixed = len(like.shape) < MATRIX or isinstance(like.shape[0], int)

    def function(observation: np.ndarray) -> np.ndarray:
        given = np.asarray(observation, dtype)
        rows = [row.reshape([d if isinstance(d, int) else 1 for d in like.shape]) for row in given]
        parts = rows if fixed else [given]
        made = [np.asarray(session.run([first], {like.name: part})[0], float) for part in parts]
        return np.concatenate([part.reshape(-1, part.shape[-1]) for part in made])

    size = like.shape[-1]
    return LoadedPolicy(function, size if isinstance(size, int) else None)


def _array(value: Any) -> np.ndarray:
    """Return a program's result as an array; raises ActorError unless it is a tensor."""
    if isinstance(value, tuple | list) and value:
        value = value[0]
    as_numpy = getattr(value, "numpy", None)
    if as_numpy is None:
        raise Sim2RealError(f"the policy returned a {type(value).__name__}, not an action")
    return as_numpy().astype(np.float64)
