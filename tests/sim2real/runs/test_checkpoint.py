"""Checkpoints: exact, whole or absent, suspicious of damage and of strangers."""

import errno
import json
import pickle
import random
import resource
import zipfile
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sim2real.runs import checkpoint
from sim2real.runs.errors import CheckpointError, DamagedCheckpointError, DiskError

FACTS = {"task": "Walk", "policy": {"hidden": [4]}}


class Walk:
    """A random walk of a tensor that an optimizer moves: all the kinds of state that there are."""

    def __init__(self, size: int = 5) -> None:
        self.rng = np.random.default_rng(0)
        self.theta = torch.zeros(size, dtype=torch.float64)
        self.optimizer = torch.optim.Adam([self.theta], lr=0.1)
        self.history: list[tuple[int, float]] = []

    def step(self) -> float:
        """Walk on; the process's own generators matter too."""
        noise = self.rng.standard_normal(len(self.theta)) + np.random.rand() + random.random()
        self.theta.grad = torch.from_numpy(noise) + torch.rand(1)
        self.optimizer.step()
        self.history.append((len(self.history), float(self.theta.sum())))
        return self.history[-1][1]

    def state_dict(self) -> dict[str, Any]:
        """Return all of it."""
        return {
            "theta": self.theta.clone(),
            "optimizer": self.optimizer.state_dict(),
            "rng": self.rng.bit_generator.state,
            "history": self.history,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back."""
        self.theta.copy_(state["theta"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.rng.bit_generator.state = state["rng"]
        self.history = state["history"]


def saved(folder: Path, iterations: int, keep: int = 5) -> tuple[Walk, checkpoint.CheckpointStore]:
    """Return a walk that was saved after each of its iterations."""
    walk, store = Walk(), checkpoint.CheckpointStore(folder, keep)
    for iteration in range(1, iterations + 1):
        store.save(walk, iteration, FACTS, walk.step())
    return walk, store


def test_a_restored_state_goes_on_to_the_last_bit(tmp_path: Path) -> None:
    """Optimizer, own generator and the process's generators return: the next steps are equal."""
    walk, _ = saved(tmp_path, 3)
    expected = [walk.step() for _ in range(4)]
    other = Walk()
    metadata = checkpoint.restore(tmp_path, other, FACTS)
    assert [other.step() for _ in range(4)] == expected
    assert torch.equal(other.theta, walk.theta)
    assert metadata["iteration"] == 3


def test_encoding_keeps_values_types_and_shapes() -> None:
    """Large integers, tuples, integer keys, empty and single-number tensors come back."""
    state = {
        "big": 2**127 + 1,
        "tuple": (1, [None, True, "x"], 0.1 + 0.2),
        7: {"scalar": torch.tensor(3.5), "empty": torch.zeros(0, 2), "ints": torch.arange(3)},
        "array": np.arange(6, dtype=np.uint64).reshape(2, 3),
    }  # fmt: skip
    arrays: dict[str, np.ndarray] = {}
    back = checkpoint.decode(json.loads(json.dumps(checkpoint.encode(state, arrays))), arrays)
    assert back["big"] == state["big"] and back["tuple"] == state["tuple"]
    for name, tensor in state[7].items():
        assert torch.equal(back[7][name], tensor) and back[7][name].dtype == tensor.dtype
    assert np.array_equal(back["array"], state["array"]) and back["array"].dtype == np.uint64


def test_an_object_cannot_enter_a_checkpoint() -> None:
    """A state with anything but plain data is refused when it is saved, not when it is needed."""
    with pytest.raises(TypeError, match=r"cannot hold a .*Path"):
        checkpoint.encode({"x": [Path("a")]}, {})


def test_the_newest_and_the_best_stay(tmp_path: Path) -> None:
    """Rotation keeps the last two and the one of the highest score; NaN is never best."""
    walk, store = Walk(), checkpoint.CheckpointStore(tmp_path, 2)
    for iteration, score in enumerate([1.0, 9.0, float("nan"), 3.0, 2.0], start=1):
        store.save(walk, iteration, FACTS, score)
    assert [int(path.stem[-2:]) for path in checkpoint.listing(tmp_path)] == [2, 4, 5]
    best = store.best()
    assert best is not None and checkpoint.read_metadata(best)["score"] == 9.0
    assert checkpoint.find(tmp_path).stem.endswith("5")


@contextmanager
def file_size_limit(size: int) -> Any:
    """Let no file of this process grow beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_write_that_fails_midway_leaves_only_the_one_before(tmp_path: Path) -> None:
    """When the file system takes no more bytes, a sentence says so; nothing half written stays."""
    walk, store = saved(tmp_path, 1)
    before = checkpoint.find(tmp_path).read_bytes()
    with file_size_limit(1000), pytest.raises(DiskError, match="iteration 2 could not be written"):
        store.save(walk, 2, FACTS, 0.0)
    assert [path.name for path in tmp_path.iterdir()] == ["checkpoint-000000000001.torchrl"]
    assert checkpoint.find(tmp_path).read_bytes() == before
    assert store.save(walk, 2, FACTS, 0.0).exists()


def test_a_full_disk_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """ENOSPC is told as such, with the newest whole checkpoint and the remedy."""
    walk, store = saved(tmp_path, 1)

    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(DiskError, match=r"No space left.*000001\.torchrl.*free some space"):
        store.save(walk, 2, FACTS, 0.0)


def test_damage_is_found_and_the_one_before_is_offered(tmp_path: Path) -> None:
    """Wherever a byte changes or the file ends early, it is refused or restores exactly."""
    saved(tmp_path, 2)
    path = checkpoint.find(tmp_path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    flips = rng.integers(len(whole), size=60).tolist()
    broken = [whole[:i] + bytes([whole[i] ^ 0x55]) + whole[i + 1 :] for i in flips]
    broken += [whole[: len(whole) // 2], whole[:-1], b""]
    reference = Walk()
    checkpoint.restore(path, reference, FACTS)
    refused = 0
    for content in broken:
        path.write_bytes(content)
        walk = Walk()
        try:
            checkpoint.restore(tmp_path, walk, FACTS)
        except DamagedCheckpointError as error:
            refused += 1
            assert "checkpoint-000000000001.torchrl" in str(error) and "\n" not in str(error)
            assert not walk.theta.any()
        else:
            assert torch.equal(walk.theta, reference.theta)
    assert refused > 40


def test_damage_without_an_earlier_one_says_so(tmp_path: Path) -> None:
    """An earlier checkpoint that is damaged too is not offered."""
    saved(tmp_path, 2)
    for path in checkpoint.listing(tmp_path):
        path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(DamagedCheckpointError, match="no whole one before it"):
        checkpoint.restore(tmp_path, Walk(), FACTS)


def test_another_task_or_policy_is_refused_with_both_values(tmp_path: Path) -> None:
    """The sentence names what the checkpoint and the run have; the algorithm is untouched."""
    saved(tmp_path, 1)
    walk = Walk()
    with pytest.raises(CheckpointError, match=r"task Walk, but this run has task Hopper"):
        checkpoint.restore(tmp_path, walk, {"task": "Hopper"})
    with pytest.raises(CheckpointError, match=r"policy\.hidden \[4\], .*policy\.hidden \[8, 8\]"):
        checkpoint.restore(tmp_path, walk, {"policy": {"hidden": (8, 8)}})
    assert not walk.theta.any()


def test_a_state_that_does_not_fit_is_refused_in_a_sentence(tmp_path: Path) -> None:
    """A shape that the metadata did not tell still ends in a sentence with the path."""
    saved(tmp_path, 1)
    with pytest.raises(CheckpointError, match=r"000001\.torchrl does not fit this run"):
        checkpoint.restore(tmp_path, Walk(size=3), FACTS)


class Bomb:
    """Writes a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.mark,))


def rebuilt(
    source: Path, target: Path, files: dict[str, bytes], adapter: str | None = None
) -> None:
    """Copy a checkpoint with some of its files replaced, all checksums right."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        manifest = json.loads(old.read("manifest.json"))
        for record in manifest["components"].values():
            record["adapter"] = adapter or record["adapter"]
            record["files"] = sorted({*record["files"], *files})
            for name in record["files"]:
                path = f"{record['path']}/{name}"
                new.writestr(path, files[name] if name in files else old.read(path))
        new.writestr("manifest.json", json.dumps(manifest))


@pytest.mark.parametrize("adapter", [None, "torchrl.state_dict", "torchrl.dump_load"])
def test_a_stranger_s_checkpoint_runs_no_code(tmp_path: Path, adapter: str | None) -> None:
    """Pickles planted where NumPy, torch or TensorDict would look are never opened."""
    saved(tmp_path / "own", 1)
    mark = tmp_path / "executed"
    bomb = pickle.dumps(Bomb(mark))
    pickle.loads(bomb)  # noqa: S301 - to show that it works
    assert mark.exists()
    mark.unlink()
    target = tmp_path / "stranger" / "checkpoint-000000000001.torchrl"
    target.parent.mkdir()
    objects = tmp_path / "objects.npz"
    bombs = {str(i): np.array([Bomb(mark)], object) for i in range(9)}
    np.savez(objects, **bombs)  # type: ignore[arg-type]
    meta = json.dumps({"_type": "<class 'tensordict._td.TensorDict'>"}).encode()
    files = {
        "arrays.npz": objects.read_bytes(),
        "state.pt": bomb,
        "state/other.pickle": bomb,
        "state/meta.json": meta,
    }
    rebuilt(checkpoint.find(tmp_path / "own"), target, files, adapter)
    walk = Walk()
    with pytest.raises(CheckpointError):
        checkpoint.restore(target, walk, FACTS)
    assert not mark.exists() and not walk.theta.any()


def test_what_a_kill_left_behind_is_cleaned(tmp_path: Path) -> None:
    """Half-written files go; a checkpoint that was being replaced comes back."""
    saved(tmp_path, 2)
    newest = checkpoint.find(tmp_path)
    newest.rename(tmp_path / f".{newest.name}.backup-abc")
    (tmp_path / f".{newest.name}.stage-abc").mkdir()
    (tmp_path / f".{newest.name}.archive-abc").write_bytes(b"half")
    checkpoint.CheckpointStore(tmp_path, 5)
    assert sorted(tmp_path.iterdir()) == checkpoint.listing(tmp_path)
    assert checkpoint.find(tmp_path) == newest


def test_what_is_no_checkpoint_is_refused(tmp_path: Path) -> None:
    """A missing path, an empty folder and a file of another kind each get their sentence."""
    with pytest.raises(CheckpointError, match="does not exist"):
        checkpoint.find(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="contains no checkpoint"):
        checkpoint.find(tmp_path)
    (tmp_path / "model.pt").write_bytes(b"x")
    with pytest.raises(CheckpointError, match=r"named checkpoint-\*\.torchrl"):
        checkpoint.read_metadata(tmp_path / "model.pt")
    with pytest.raises(CheckpointError, match="keep_checkpoints=0"):
        checkpoint.CheckpointStore(tmp_path, 0)
