"""Checkpoints: all that a run needs to continue, in one file that is whole or absent.

    store = CheckpointStore("outputs/run/checkpoints", keep_last=3)
    store.save(algorithm, iteration=10, metadata={"task": "Hopper"}, score=812.0)
    metadata = restore(find("outputs/run"), algorithm, expected={"task": "Hopper"})

Contracts:

* The algorithm's state and the process's random generators return to the last bit
  (`torchrl.checkpoint`).
* A file appears under its name only when it is complete. One whose bytes have changed since is
  refused, with the path of the one before it; nothing falls back to another checkpoint by itself.
* Reading runs no code: a file holds JSON and plain arrays. Whatever else is in it is never opened.
* The newest `keep_last` stay, and the one of the highest score.
"""

import json
import re
import shutil
import sys
import zipfile
from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torchrl.checkpoint import Checkpoint, CheckpointAdapter, CheckpointRotation, GlobalRNGState

from sim2real.runs.errors import CheckpointError, DamagedCheckpointError, DiskError
from sim2real.runs.tree import flatten

FOLDER = "checkpoints"
_NAME = re.compile(r"checkpoint-(\d+)\.torchrl")
_SCORE = "score"


class Stateful(Protocol):
    """An object that can be saved: its state is plain data, which `encode` lists."""

    def state_dict(self) -> dict[str, Any]:
        """Return all that its future depends on."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to a state."""
        ...


def encode(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """Turn a state into JSON and arrays.

    Args:
        value: the state: tensors, arrays, numbers, text, None, lists, tuples and dicts of them.
        arrays: its tensors and arrays are added here.

    Raises:
        TypeError: for an object of any other kind.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, torch.Tensor | np.ndarray):
        kind = "tensor" if isinstance(value, torch.Tensor) else "array"
        key = str(len(arrays))
        arrays[key] = value.detach().cpu().numpy() if isinstance(value, torch.Tensor) else value
        return {kind: key}
    if isinstance(value, Mapping):
        return {"dict": [[encode(k, arrays), encode(v, arrays)] for k, v in value.items()]}
    if isinstance(value, list | tuple):
        kind = "list" if isinstance(value, list) else "tuple"
        return {kind: [encode(item, arrays) for item in value]}
    raise TypeError(
        f"a checkpoint cannot hold a {type(value).__name__}; state_dict() must return plain data"
    )


def decode(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """Undo `encode`."""
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "tensor":
        return torch.from_numpy(arrays[content].copy())
    if kind == "array":
        return arrays[content].copy()
    if kind == "dict":
        return {decode(k, arrays): decode(v, arrays) for k, v in content}
    items = [decode(item, arrays) for item in content]
    return items if kind == "list" else tuple(items)


class PlainStateAdapter(CheckpointAdapter):
    """Stores a state as `state.json` and `arrays.npz`, neither of which can name code.

    TorchRL's own adapter also opens TensorDict folders, which may hold pickles, so it is not used.
    """

    adapter_id = "sim2real.plain_state"

    def save(
        self, component: Any, path: Path, *, args: tuple[Any, ...], kwargs: Mapping[str, Any]
    ) -> None:
        """Write `component.state_dict()` into the folder `path`."""
        arrays: dict[str, np.ndarray] = {}
        text = json.dumps(encode(component.state_dict(), arrays))
        path.mkdir(parents=True, exist_ok=True)
        (path / "state.json").write_text(text, encoding="utf-8")
        np.savez(path / "arrays.npz", allow_pickle=False, **arrays)  # type: ignore[arg-type]

    def load(
        self,
        component: Any,
        path: Path,
        *,
        map_location: Any,
        tensor_load_kwargs: Mapping[str, Any],
        args: tuple[Any, ...],
        kwargs: Mapping[str, Any],
    ) -> None:
        """Hand the state in the folder `path` to `component.load_state_dict`."""
        text = (path / "state.json").read_text(encoding="utf-8")
        with np.load(path / "arrays.npz", allow_pickle=False) as arrays:
            component.load_state_dict(decode(json.loads(text), arrays))


class _Holder:
    """Takes a state from a file, so that a damaged one never reaches the algorithm half read."""

    state: dict[str, Any]

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.state = state


def _container(**components: Any) -> Checkpoint:
    """Return TorchRL's checkpoint of these components, each through the plain adapter."""
    container = Checkpoint(format="archive", strict="error")
    for name, component in components.items():
        container.register(name, component, adapter=PlainStateAdapter())
    return container


class CheckpointStore:
    """The checkpoints of one run.

    Args:
        folder: where they are; made when the first is saved.
        keep_last: how many of the newest stay, at least 1. The one of the highest score stays too.

    Raises:
        CheckpointError: for keep_last below 1.
    """

    def __init__(self, folder: str | Path, keep_last: int) -> None:
        if keep_last < 1:
            raise CheckpointError(
                f"keep_checkpoints={keep_last} must be at least 1: runs resume from the last one"
            )
        self.folder = Path(folder)
        self._rotation = CheckpointRotation(
            self.folder, keep_last=keep_last, keep_best=(_SCORE, "max")
        )
        self._clean()

    def _clean(self) -> None:
        """Remove what a writer that was killed has left, and put back what it had moved aside."""
        for leftover in self.folder.glob(".checkpoint-*"):
            name, _, kind = leftover.name[1:].partition(".torchrl")
            target = self.folder / f"{name}.torchrl"
            if kind.startswith(".backup-") and not target.exists():
                leftover.replace(target)
            else:
                shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()

    def save(
        self, algorithm: Stateful, iteration: int, metadata: Mapping[str, Any], score: float
    ) -> Path:
        """Write a checkpoint and drop those that are no longer kept.

        Args:
            algorithm: what is saved.
            iteration: iterations done; the file is named after it.
            metadata: what describes the run, JSON values.
            score: what the best checkpoint is chosen by, higher is better; NaN is worst.

        Raises:
            DiskError: when it could not be written. The checkpoints before are untouched.
        """
        container = _container(algorithm=algorithm, random=GlobalRNGState())
        score = score if isfinite(score) else -sys.float_info.max
        facts = {**metadata, "iteration": iteration, _SCORE: score}
        try:
            return self._rotation.save(container, step=iteration, metadata=facts)
        except OSError as error:
            newest = self.latest()
            kept = f"the newest whole one is {newest}" if newest else "there is none before it"
            raise DiskError(
                f"the checkpoint of iteration {iteration} could not be written to {self.folder} "
                f"({error.strerror or error}); {kept}; {DiskError.remedy(error)}, then resume"
            ) from error

    def latest(self) -> Path | None:
        """Return the newest checkpoint, if there is any."""
        paths = listing(self.folder)
        return paths[-1] if paths else None

    def best(self) -> Path | None:
        """Return the checkpoint of the highest score, if there is any."""
        return self._rotation.best()

    def adopt(self, source: Path) -> None:
        """Take over the checkpoints up to `source` from its folder, to continue another run.

        Later ones in the same folder step aside under another name.
        """
        if source.parent.resolve() == self.folder.resolve():
            for path in listing(self.folder):
                if _iteration(path) > _iteration(source):
                    path.replace(path.with_suffix(".superseded"))
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        for path in listing(source.parent):
            if _iteration(path) <= _iteration(source):
                temporary = self.folder / f".{path.name}"
                shutil.copyfile(path, temporary)
                temporary.replace(self.folder / path.name)


def _iteration(path: Path) -> int:
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else -1


def listing(folder: Path) -> list[Path]:
    """Return the checkpoints in a folder by iteration, damaged ones included."""
    found = [path for path in folder.glob("checkpoint-*.torchrl") if _NAME.fullmatch(path.name)]
    return sorted(found, key=_iteration)


def find(path: str | Path) -> Path:
    """Return the checkpoint that a user means by a run folder, a folder of checkpoints or a file.

    Raises:
        CheckpointError: when there is none.
    """
    path = Path(path).expanduser()
    if path.is_file():
        return path
    if not path.exists():
        raise CheckpointError(
            f"checkpoint {path} does not exist; give a run folder or a file checkpoint-*.torchrl"
        )
    for folder in (path / FOLDER, path):
        if files := listing(folder):
            return files[-1]
    raise CheckpointError(
        f"{path} contains no checkpoint; give a run folder or a file checkpoint-*.torchrl"
    )


def run_folder(checkpoint: Path) -> Path:
    """Return the folder of the run that a checkpoint file belongs to."""
    return checkpoint.resolve().parent.parent


def read_metadata(path: str | Path) -> dict[str, Any]:
    """Return a checkpoint's description, without its state.

    Raises:
        CheckpointError: for a file that is not a checkpoint, or a damaged one.
    """
    path = find(path)
    if path.suffix != ".torchrl":
        raise CheckpointError(
            f"{path} is not a checkpoint of this program; they are named checkpoint-*.torchrl"
        )
    try:
        return dict(Checkpoint.manifest(path)["metadata"])
    except Exception as error:  # whatever a changed byte makes of a file
        raise _damaged(path, error) from error


def restore(
    path: str | Path, algorithm: Stateful, expected: Mapping[str, Any], generators: bool = True
) -> dict[str, Any]:
    """Put an algorithm into the state of a checkpoint.

    Args:
        path: a checkpoint; see `find`.
        algorithm: built as it was when the checkpoint was written; untouched if anything is wrong.
        expected: metadata that must be equal, such as the task and the policy's shape.
        generators: whether the process's global random generators return too, as resuming needs.
            Without them an algorithm that has `load_policy` takes over its policy alone.

    Returns:
        The checkpoint's metadata.

    Raises:
        DamagedCheckpointError: when the file's bytes have changed.
        CheckpointError: when it is of another task or policy, or there is none.
    """
    path = find(path)
    metadata = read_metadata(path)
    check_expected(path, metadata, expected)
    held, random = _Holder(), _Holder()
    try:
        _container(algorithm=held, random=random).load(path)
    except Exception as error:  # whatever a changed byte makes of a file
        raise _damaged(path, error) from error
    load = algorithm.load_state_dict
    if not generators:
        load = getattr(algorithm, "load_policy", load)
    try:
        load(held.state)
        if generators:
            GlobalRNGState().load_state_dict(random.state)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(f"checkpoint {path} does not fit this run: {error}") from error
    return metadata


def check_expected(path: Path, metadata: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Raise CheckpointError, naming both values, where metadata differ from what is expected."""
    there, here = flatten(metadata), flatten(json.loads(json.dumps(expected)))
    for key, value in here.items():
        if there.get(key) != value:
            raise CheckpointError(
                f"checkpoint {path} has {key} {there.get(key)}, but this run has {key} {value}; "
                f"give the run the checkpoint's {key.split('.')[0]}, or another checkpoint"
            )


def _damaged(path: Path, error: Exception) -> DamagedCheckpointError:
    """Describe a damaged file and offer the checkpoint before it."""
    earlier = [p for p in listing(path.parent) if _iteration(p) < _iteration(path) and _is_whole(p)]
    offer = (
        f"the one before it is whole: {earlier[-1]}"
        if earlier
        else "there is no whole one before it"
    )
    reason = " ".join(str(error).split()) or type(error).__name__
    return DamagedCheckpointError(f"checkpoint {path} is damaged ({reason}); {offer}")


def _is_whole(path: Path) -> bool:
    """Return whether all bytes of a checkpoint are as they were written."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.testzip() is None and Checkpoint.is_checkpoint(path)
    except Exception:  # whatever a changed byte makes of a file
        return False
