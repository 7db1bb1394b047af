"""Policies from files: the same actions from each format, and nothing that runs code."""

import io
import json
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from hardware.exported import SCHEMA
from sim2real.deployment import actors
from sim2real.deployment.actors import load_actor
from sim2real.deployment.program_check import ActorError, check_program
from sim2real.deployment.trained import load_policy
from tests.sim2real.trained import SMALL_ES, SMALL_PPO, train

SEEN = np.random.default_rng(0).normal(size=(7, 5))


@pytest.fixture(scope="module")
def network() -> nn.Module:
    """A small perceptron of five observations and two actions."""
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(5, 4), nn.Tanh(), nn.Linear(4, 2))


@pytest.fixture(scope="module")
def wanted(network) -> np.ndarray:
    """What it does."""
    with torch.no_grad():
        return network(torch.from_numpy(SEEN).float()).numpy()


@pytest.fixture(scope="module")
def program(network, tmp_path_factory) -> Path:
    """It as an archive of torch.export for any number of observations."""
    path = tmp_path_factory.mktemp("program") / "policy.pt2"
    rows = torch.export.Dim("rows", min=1)
    example = (torch.zeros(2, 5),)
    torch.export.save(torch.export.export(network, example, dynamic_shapes=({0: rows},)), path)
    return path


def test_a_program_computes_what_the_network_does(program, wanted):
    """torch.export's archive is data, and gives the same actions."""
    actor = load_actor(program)
    assert actor.size == 5
    assert actor(SEEN) == pytest.approx(wanted, abs=1e-6)


def test_a_program_of_one_observation_is_asked_row_by_row(network, wanted, tmp_path):
    """An archive with a fixed batch of one is as good."""
    one = torch.export.export(network, (torch.zeros(1, 5),))
    torch.export.save(one, tmp_path / "one.pt2")
    assert load_actor(tmp_path / "one.pt2")(SEEN) == pytest.approx(wanted, abs=1e-6)


def rewritten(program: Path, out: Path, ending: str, content: bytes) -> Path:
    """Copy an archive with another content of one member."""
    with zipfile.ZipFile(program) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            new.writestr(name, content if name.endswith(ending) else old.read(name))
    return out


class Evil:
    """What a pickle would run."""

    def __reduce__(self):
        return (Path.touch, (Path("ran"),))


def test_an_archive_that_could_run_code_is_refused(program, tmp_path, monkeypatch):
    """An operator that is none, an expression that calls, a pickle with a class, compiled code."""
    monkeypatch.chdir(tmp_path)
    check_program(program)
    with zipfile.ZipFile(program) as archive:
        name = next(n for n in archive.namelist() if n.endswith("models/model.json"))
        model = archive.read(name).decode()
    operator = model.replace("torch.ops.aten.tanh.default", "torch.hub.load", 1)
    size = json.loads(model)
    size["graph_module"]["graph"]["expr_str"] = "__import__('os').system('touch ran')"
    buffer = io.BytesIO()
    torch.save({"a": Evil()}, buffer)
    bad = {
        "operator": ("models/model.json", operator.encode(), "torch.hub.load"),
        "size": ("models/model.json", json.dumps(size).encode(), "__import__"),
        "pickle": ("model.pt", buffer.getvalue(), "more than tensors"),
        "raw": ("weight_0", pickle.dumps(Evil(), protocol=2), "more than tensors"),
    }
    for what, (ending, content, words) in bad.items():
        file = rewritten(program, tmp_path / f"{what}.pt2", ending, content)
        with pytest.raises(ActorError, match="rejected") as refused:
            load_actor(file)
        assert words in str(refused.value)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("ending", [".pt", ".pth", ".pkl", ".jit"])
def test_files_that_run_code_are_refused_unread(tmp_path, ending):
    """TorchScript and pickles get a sentence with what to export instead."""
    (tmp_path / f"policy{ending}").write_bytes(b"")
    with pytest.raises(ActorError, match=r"export the policy as ONNX"):
        load_actor(tmp_path / f"policy{ending}")


def test_an_export_of_ours_knows_its_normalizer(tmp_path):
    """policy.npz beside policy.json: the folder, or either file."""
    import hashlib

    arrays = {
        "mean": np.array([1.0, 2.0]),
        "std": np.array([2.0, 4.0]),
        "low": np.full(1, -1.0),
        "high": np.ones(1),
        "weight_0": np.array([[1.0], [0.5]], np.float32),
        "bias_0": np.zeros(1, np.float32),
    }
    np.savez(tmp_path / "policy.npz", **arrays)
    digest = hashlib.sha256((tmp_path / "policy.npz").read_bytes()).hexdigest()
    facts = {
        "schema": SCHEMA, "robot": "bench1", "rate": 50.0, "task": "Bench1", "joints": ["hinge"],
        "observation": {"names": ["a", "b"], "mean": [1.0, 2.0], "std": [2.0, 4.0]},
        "activation": "tanh", "squash": "clip", "layers": 1,
        "golden": {"observation": [[1.0, 2.0]], "action": [[0.0]]},
        "sha256": {"policy.npz": digest},
    }  # fmt: skip
    (tmp_path / "policy.json").write_text(json.dumps(facts))
    for path in (tmp_path, tmp_path / "policy.npz", tmp_path / "policy.json"):
        actor = load_actor(path)
        assert (actor.size, actor.task) == (2, "Bench1")
        assert actor(np.array([[2.0, 4.0]])) == pytest.approx(np.array([[0.75]]))
        assert actor.normalizer == pytest.approx(np.array([[1.0, 2.0], [2.0, 4.0]]))


def test_onnx_without_onnxruntime_says_what_to_install(tmp_path, monkeypatch):
    """The extra is named."""
    (tmp_path / "policy.onnx").write_bytes(b"")
    monkeypatch.setattr(actors, "find_spec", lambda _: None)
    with pytest.raises(ActorError, match=r"pip install 'sim2real\[onnx\]'"):
        load_actor(tmp_path / "policy.onnx")


@pytest.mark.parametrize("batch", ["rows", 1])
def test_onnx_computes_what_the_network_does(network, wanted, tmp_path, batch):
    """Any batch, or a fixed one of a single observation."""
    pytest.importorskip("onnxruntime", reason="needs onnxruntime: pip install 'sim2real[onnx]'")
    onnx = pytest.importorskip("onnx", reason="writes the model: pip install 'sim2real[onnx]'")
    weights = {n: v.detach().numpy() for n, v in network.named_parameters()}
    make, number = onnx.helper, onnx.TensorProto.FLOAT
    nodes = [
        make.make_node("Gemm", ["obs", "0.weight", "0.bias"], ["h"], transB=1),
        make.make_node("Tanh", ["h"], ["t"]),
        make.make_node("Gemm", ["t", "2.weight", "2.bias"], ["action"], transB=1),
    ]
    graph = make.make_graph(
        nodes,
        "policy",
        [make.make_tensor_value_info("obs", number, [batch, 5])],
        [make.make_tensor_value_info("action", number, [batch, 2])],
        [onnx.numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    opset = [make.make_opsetid("", 17)]
    model = make.make_model(graph, opset_imports=opset, ir_version=8)
    (tmp_path / "policy.onnx").write_bytes(model.SerializeToString())
    actor = load_actor(tmp_path / "policy.onnx")
    assert actor.size == 5
    assert actor(SEEN) == pytest.approx(wanted, abs=1e-5)


def test_a_policy_that_is_not_there(tmp_path):
    """One sentence."""
    with pytest.raises(ActorError, match="no such policy"):
        load_actor(tmp_path / "policy.onnx")


@pytest.mark.parametrize("words", [SMALL_ES, SMALL_PPO], ids=["es", "ppo"])
def test_a_run_of_ours_acts_as_on_the_robot(tmp_path, words):
    """A run's folder, or a checkpoint in it: what its pilot does, statistics included."""
    run = train(tmp_path / "run", words)
    trained = load_policy(run)
    size = trained.environment.observation_and_action_spec()[0]
    inside = load_actor(run).normalizer
    assert inside is not None and trained.source is not None
    mean, std = inside
    seen = mean + std * np.random.default_rng(3).normal(0, 2.0, (6, size))
    pilot, wanted = trained.controller(), []
    for row in seen:
        pilot.reset()
        wanted.append(pilot(row[None])[0])
    for path in (run, trained.source):
        actor = load_actor(path)
        assert (actor.size, actor.task) == (size, "Bench1")
        assert actor(seen) == pytest.approx(np.array(wanted), abs=1e-5)
