"""Exported policies: the same actions from torch.export and NumPy, without TorchRL or torch."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
from torch import nn

from envs import MujocoEnv
from envs.tasks import Bench1, Quad8
from hardware.exported import ExportedPolicy, PolicyError
from sim2real.config.compose import compose, instantiate
from sim2real.deployment.export import ExportError, check_parity, export, to_arrays
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.interface import FILE
from sim2real.learning.interface import observation_names as names
from sim2real.learning.modules.acting import Acting
from sim2real.learning.trained import TrainedPolicy, flatten_parameters
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.trained import SMALL_ES, SMALL_PPO, train

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    """Policies of evolution strategies and of PPO, exported."""
    out, made = tmp_path_factory.mktemp("export"), {}
    for name, overrides in (("es", SMALL_ES), ("ppo", SMALL_PPO)):
        run = train(out / name, overrides)
        verb, arguments = instantiate(
            compose(["run=export", f"checkpoint={run}"]), out / f"{name}-out"
        )
        verb(**arguments)
        made[name] = out / f"{name}-out"
    return made


@pytest.fixture(params=["es", "ppo"])
def folder(request, folders) -> Path:
    """One exported policy after the other."""
    return folders[request.param]


def edited(folder: Path, out: Path, **changes: Any) -> Path:
    """Copy an exported policy with changes of its JSON."""
    out.mkdir(exist_ok=True)
    facts = json.loads((folder / "policy.json").read_text()) | changes
    (out / "policy.json").write_text(json.dumps(facts))
    (out / "policy.npz").write_bytes((folder / "policy.npz").read_bytes())
    return out


def exportable(module: nn.Module) -> TrainedPolicy:
    """Return a torch module as a trained policy."""
    environment = EnvironmentFactory(partial(MujocoEnv, task=Bench1()))
    acting, theta = Acting(module), flatten_parameters(module)
    made = TrainedPolicy(theta, lambda _: acting, environment, {}, 0, dtype=torch.float64)
    return replace(made, program=lambda _: module)


def test_all_three_compute_the_same(folder):
    """NumPy and torch.export agree to 1e-6 on observations that were not compared at export."""
    policy = ExportedPolicy.load(folder)
    program = torch.export.load(folder / "policy.pt2").module()
    seen = np.random.default_rng(5).normal(0, 3, (200, 6))
    with torch.no_grad():
        wanted = program(torch.from_numpy(seen)).numpy()
    assert np.abs(policy(seen) - wanted).max() < 1e-6
    assert np.abs(policy(seen[0]) - wanted[0]).max() < 1e-6
    assert np.ptp(wanted) > 1e-4


def test_it_says_what_it_is(folder):
    """Robot, servos, rate, observation, limits and origin stand in the JSON."""
    facts = json.loads((folder / "policy.json").read_text())
    assert (facts["robot"], facts["rate"], facts["joints"]) == ("bench1", 50.0, ["hinge"])
    assert facts["observation"]["names"] == [
        *("angle.hinge", "speed.hinge", "time", "time", "time", "action.0")
    ]
    assert facts["action"] == {"low": [-0.8], "high": [0.8]}
    assert facts["checkpoint"].startswith("checkpoint-")
    assert facts["frames"] > 0


def test_a_run_from_before_interfaces_gets_one(folders, tmp_path, monkeypatch, caplog):
    """Also one whose policy cannot be exported: `deploy` refuses the run without it."""

    def refuse(*_: object) -> None:
        raise ExportError("it has a memory")

    run = Path(shutil.copytree(folders["es"].with_name("es"), tmp_path / "run"))
    interface = (run / FILE).read_text()
    (run / FILE).unlink()
    monkeypatch.setattr("sim2real.verbs.export.export", refuse)
    verb, arguments = instantiate(compose(["run=export", f"checkpoint={run}"]), tmp_path / "out")
    with pytest.raises(ExportError, match="memory"):
        verb(**arguments)
    assert (run / FILE).read_text() == interface
    assert "`deploy` takes the run now" in caplog.text


def test_names_are_what_an_observation_changes_with():
    """The walking robot sees how it is turned, its angles, and its clock; no speed, no position."""
    found = names(Quad8())
    assert found[:2] == ["orientation", "orientation"]
    assert found[2:4] == ["angle.hip_fl", "angle.knee_fl"]
    assert found[10] == "time"
    assert not any("speed" in name for name in found)


def test_it_drives_the_emulated_servos_without_torch(folders):
    """In a process where torch, TorchRL and TensorDict cannot be imported."""
    program = f"""
import sys
for name in ("torch", "torchrl", "tensordict"):
    sys.modules[name] = None
import numpy as np
from envs.tasks import Bench1
from hardware.backends import ServoBackend
from hardware.config import load_robot
from hardware.exported import ExportedPolicy
from hardware.rows import RobotRows
policy = ExportedPolicy.load({str(folders["ppo"])!r})
backend = ServoBackend(load_robot(policy.robot), settle=0.1)
rows = RobotRows(Bench1(seconds=0.4), backend)
rows.arm()
observation, total = rows.reset(np.arange(1), np.zeros((1, 0)), np.zeros(1, np.uint64)), 0.0
while not rows.over:
    step = rows.step(None, policy(observation))
    observation, total = step.observation, total + step.reward[0]
rows.close()
assert not backend.world.firmware.torque_on.any()
print(total, rows.stopped)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    total, stopped = done.stdout.split()
    assert -1.0 < float(total) < 0.0
    assert stopped == "None"


@pytest.mark.slow
def test_the_program_needs_torch_alone(folders):
    """policy.pt2 is loaded and run where TorchRL and this project cannot be imported."""
    program = f"""
import sys
for name in ("torchrl", "tensordict", "envs", "hardware", "sim2real"):
    sys.modules[name] = None
import json, torch
policy = torch.export.load({str(folders["es"] / "policy.pt2")!r}).module()
golden = json.load(open({str(folders["es"] / "policy.json")!r}))["golden"]
seen, wanted = (torch.tensor(golden[k], dtype=torch.float64) for k in ("observation", "action"))
assert (policy(seen) - wanted).abs().max() < 1e-6
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd="/", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_damage_is_found(folders, tmp_path):
    """Other numbers, another schema, a missing key, and a file that is not there."""
    folder = folders["es"]
    golden = json.loads((folder / "policy.json").read_text())["golden"]
    golden["action"][0][0] += 1e-3
    with pytest.raises(PolicyError, match="actions are off by"):
        ExportedPolicy.load(edited(folder, tmp_path, golden=golden))
    with pytest.raises(PolicyError, match="schema 2, not 1"):
        ExportedPolicy.load(edited(folder, tmp_path, schema=2))
    with pytest.raises(PolicyError, match="are not a policy"):
        ExportedPolicy.load(edited(folder, tmp_path, squash="sigmoid"))
    with pytest.raises(PolicyError, match=r"lacks 'weight_"):
        ExportedPolicy.load(edited(folder, tmp_path, layers=9))
    with pytest.raises(PolicyError, match="not the one that policy"):
        ExportedPolicy.load(edited(folder, tmp_path, sha256={}))
    with pytest.raises(PolicyError, match="exported policy is incomplete"):
        ExportedPolicy.load(tmp_path / "nothing")
    with pytest.raises(PolicyError, match=r"an observation has 6 numbers, angle\.hinge"):
        ExportedPolicy.load(folder)(np.zeros(5))


class Odd(nn.Module):
    """A policy whose network is no perceptron."""

    def __init__(self, *layers: nn.Module) -> None:
        super().__init__()
        self.network = nn.Sequential(*layers)


@pytest.mark.parametrize(
    "layers",
    [
        (nn.Linear(6, 4), nn.Sigmoid(), nn.Linear(4, 1)),
        (nn.Linear(6, 4), nn.Tanh(), nn.Linear(4, 3), nn.ReLU(), nn.Linear(3, 1)),
        (nn.Linear(6, 1), nn.Tanh()),
        (),
    ],
)
def test_a_network_that_numpy_cannot_have_is_refused(layers):
    """Other nonlinearities, mixed ones, a last one, and none at all."""
    with pytest.raises(ExportError, match="is not a perceptron with one nonlinearity"):
        to_arrays(Odd(*layers), Bench1())


def test_what_does_not_agree_is_not_written(tmp_path):
    """A policy that computes something beside its layers is found by the comparison."""

    class Sly(Odd):
        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            return self.network(observation.to(torch.float32)) + 1e-3

    module = Sly(nn.Linear(6, 1))
    module.register_buffer("observation_mean", torch.zeros(6, dtype=torch.float64))
    module.register_buffer("observation_std", torch.ones(6, dtype=torch.float64))
    trained = exportable(module)
    with pytest.raises(ExportError, match=r"policy.npz differs .* by"):
        export(trained, Bench1(), tmp_path / "out", np.random.default_rng(0))
    assert not (tmp_path / "out").exists()
    with pytest.raises(ExportError):
        check_parity(np.array([[np.nan]]), np.array([[0.0]]), "policy.pt2")


def test_steep_policies_are_exported_too(tmp_path):
    """Weights of trained walkers are large: float32 rounds in another order, and no more."""

    class Steep(Odd):
        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            return self.network(observation.to(torch.float32))

    rng = np.random.default_rng(0)
    weights = rng.normal(0, 30, (1, 6)).astype(np.float32)
    layer = nn.Linear(6, 1, bias=True)
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(weights))
        layer.bias.zero_()
    module = Steep(layer)
    module.register_buffer("observation_mean", torch.zeros(6, dtype=torch.float64))
    module.register_buffer("observation_std", torch.ones(6, dtype=torch.float64))
    trained = exportable(module)
    export(trained, Bench1(), tmp_path / "out", rng)
    policy, seen = ExportedPolicy.load(tmp_path / "out"), rng.normal(0, 1, (50, 6))
    np.testing.assert_allclose(policy(seen), seen @ weights.T, atol=1e-4)


def test_a_checkpoint_is_needed(tmp_path):
    """Without one there is nothing to export."""
    verb, arguments = instantiate(compose(["run=export", "env=bench1"]), tmp_path)
    with pytest.raises(Sim2RealError, match="expected one trained policy, none was given"):
        verb(**arguments)


def exported(out: Path, entries: str, *overrides: str) -> Path:
    """Export effects that were found on bench1."""
    out.mkdir()
    (out / "effects.yaml").write_text(entries)
    given = [f"effects={out / 'effects.yaml'}", f"model={ROOT / 'envs/assets/bench1.xml'}"]
    verb, arguments = instantiate(compose(["run=export", *given, *overrides]), out / "out")
    return verb(**arguments)


FOUND = """
- {effect: coulomb_friction, where: hinge, value: 0.03}
- {effect: position_gain, where: hinge, value: 0.8}
"""


def test_effects_become_mjcf(tmp_path):
    """The file has the values; a play becomes a joint."""
    folder = exported(
        tmp_path / "a", FOUND + "- {effect: backlash, where: hinge, value: 0.05}", "to=mjcf"
    )
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    nominal = mujoco.MjModel.from_xml_path(str(ROOT / "envs/assets/bench1.xml"))
    assert model.joint("hinge").frictionloss[0] == pytest.approx(0.03, abs=1e-6)
    assert model.actuator_gainprm[0, 0] == pytest.approx(0.8 * nominal.actuator_gainprm[0, 0])
    assert model.njnt == nominal.njnt + 1


def test_effects_become_terms_of_mjlab(tmp_path):
    """The module names the model and is Python."""
    text = (exported(tmp_path / "a", FOUND, "to=mjlab") / "events.py").read_text()
    compile(text, "events.py", "exec")
    assert "found on bench1.xml" in text and "func=dr.joint_friction" in text


@pytest.mark.parametrize(("to", "name"), [("mjcf", "stribeck_friction"), ("mjlab", "backlash")])
def test_what_the_target_cannot_say_is_refused_before_anything_is_written(tmp_path, to, name):
    """The effect is named, and the others are not written without it."""
    entry = f"- {{effect: {name}, where: hinge, value: 0.02}}"
    with pytest.raises(Sim2RealError, match=rf"to={to} cannot say {name}\.hinge \("):
        exported(tmp_path / "a", FOUND + entry, f"to={to}")
    assert not list((tmp_path / "a").rglob("*.xml")) + list((tmp_path / "a").rglob("*.py"))


@pytest.mark.parametrize("given", [["to=mjcf"], ["effects=e.yaml", "to=mjcf"], ["effects=e.yaml"]])
def test_effects_need_their_model_and_a_target(tmp_path, given):
    """One sentence says what is missing."""
    verb, arguments = instantiate(compose(["run=export", *given]), tmp_path)
    with pytest.raises(Sim2RealError, match="effects with the model that they were found on"):
        verb(**arguments)
