"""A policy on named robots: the robots are what they are called, and the luck is shared."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
from torch import nn

from envs import HopperPolito, MujocoEnv, make
from envs.errors import TaskError
from envs.toys import Nav2D, ToyEnv
from sim2real.config.compose import compose, instantiate
from sim2real.evaluation.transfer import (
    Transfer,
    TransferError,
    env_with_robot,
    read,
    true_context,
)
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.environment import EnvironmentFactory, environment_of
from sim2real.learning.modules.acting import Acting
from sim2real.learning.trained import TrainedPolicy

ROBOTS = {"source": {"domain": "source"}, "target": {"domain": "target"}}


class Still(nn.Module):
    """Never moves."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return no torque for each row."""
        return torch.zeros(len(observation), 3)


class Motionless(Algorithm):
    """The least that can be assessed."""

    def __init__(self, environment: EnvironmentFactory) -> None:
        self.parts = Components(environment, policy=None)  # type: ignore[arg-type]

    def trained(self) -> TrainedPolicy:
        """Return the policy."""
        world = self.parts.environment
        return TrainedPolicy(np.zeros(0), lambda theta: Acting(Still()), world, {}, 4096)

    frames = 4096
    iterate = shape = state_dict = load_state_dict = None  # type: ignore[assignment]


def env(**changes: Any) -> EnvironmentFactory:
    """Return what makes a short Hopper of the study."""
    arguments: dict[str, Any] = {"max_steps": 40, **changes}
    return EnvironmentFactory(partial(MujocoEnv, task=HopperPolito(**arguments)))


def assess(world: EnvironmentFactory, **robots: dict[str, Any]) -> Any:
    """Return the scores of the policy that never moves."""
    transfer = Transfer(robots or ROBOTS, episodes=4)
    return transfer.assess(Motionless(world), 0, "seed 0")


def torso(world: EnvironmentFactory, robot: str, **changes: Any) -> float:
    """Return the mass of a robot's torso [kg]."""
    rows: Any = env_with_robot(world, robot, changes).base_rows(1)
    model: mujoco.MjModel = rows.plant.model
    return float(model.body("torso").mass[0])


def test_the_target_is_a_kilogram_heavier_and_all_else_is_the_runs_own() -> None:
    """Whatever the run was trained on, and with its own choice of masses."""
    for domain in ("source", "target"):
        own = env(domain=domain, masses="legacy")
        light = torso(own, "source", domain="source")
        assert torso(own, "target", domain="target") == pytest.approx(light + 1.0)
        assert light == pytest.approx(2.53429174)


def test_robots_share_the_luck_and_differ_by_their_physics() -> None:
    """The same robot under two names gets the same returns; another one does not."""
    scores = assess(env(), one={}, same={"domain": "source"}, other={"domain": "target"})
    np.testing.assert_array_equal(scores.returns["one"], scores.returns["same"])
    assert (scores.returns["one"] != scores.returns["other"]).all()
    assert len(set(scores.returns["one"].tolist())) == 4


def test_it_says_which_robot_the_training_had() -> None:
    """That decides the table that a run belongs to."""
    assert assess(env()).trained_on == "source"
    assert assess(env(domain="target")).trained_on == "target"
    assert assess(env(), heavy={"domain": "target"}).trained_on is None


def test_a_robot_may_have_effects(tmp_path: Path) -> None:
    """An effects.yaml turns the source into the target, within the rounding of a mass."""
    file = tmp_path / "found.yaml"
    file.write_text("- {effect: link_mass, where: torso, value: 1.0}\n", encoding="utf-8")
    scores = assess(env(), target={"domain": "target"}, found={"effects": str(file)})
    np.testing.assert_allclose(scores.returns["found"], scores.returns["target"], rtol=1e-6)
    assert scores.trained_on is None


def test_effects_of_the_runs_simulator_are_not_the_robots() -> None:
    """A policy from a corrected simulator is tried on robots that are what they are called."""
    heavier = [(make("link_mass", where="torso"), [1.0])]
    corrected = replace(env(), fixed=heavier)
    plain, found = assess(env()), assess(corrected)
    for robot in ROBOTS:
        np.testing.assert_array_equal(plain.returns[robot], found.returns[robot])
    assert (plain.trained_on, found.trained_on) == ("source", None)


def conditioned(low: float, high: float, *words: str, **effect: Any) -> EnvironmentFactory:
    """Return the study's Hopper, whose policy receives one parameter of the robot."""
    own = ["env=hopper_polito", "env.task.masses=legacy", "params=mass_friction"]
    tree = compose([*own, "transforms=with_params", *words])
    draw: dict[str, Any] = {"effect": "link_mass", "where": "torso", **effect}
    tree["params"]["draws"] = [{**draw, "low": low, "high": high}]
    return environment_of(tree)


def received(world: EnvironmentFactory, **robot: Any) -> Any:
    """Return what a policy receives of a robot."""
    return true_context(world, "robot", env_with_robot(world, "robot", robot))


@pytest.mark.parametrize(
    ("how", "low", "high", "truth"),
    [("set", 1.0, 5.0, 3.53429174), ("add", -2.0, 2.0, 1.0), ("scale", 0.0, 2.0, 1.39458762)],
)
def test_a_policy_receives_the_parameters_of_the_named_robot(
    how: str, low: float, high: float, truth: float
) -> None:
    """They are relative to the model of the training where the policy learned them so."""
    world = conditioned(low, high, how=how)
    said = received(world, domain="target")
    middle, half = (low + high) / 2, (high - low) / 2
    np.testing.assert_allclose(said, [(truth - middle) / half], rtol=1e-6)


def test_a_named_robot_s_effects_are_what_its_policy_receives(tmp_path: Path) -> None:
    """Whatever the way of the training; what that cannot say is refused, or nobody asks for it."""
    file = tmp_path / "other.yaml"
    file.write_text("- {effect: link_mass, where: torso, value: 1.0}\n", encoding="utf-8")
    other = {"effects": str(file)}
    np.testing.assert_allclose(received(conditioned(-2.0, 2.0, how="add"), **other), [0.5])
    scaled = conditioned(0.0, 2.0, how="scale")
    np.testing.assert_allclose(received(scaled, **other), [0.39458762], rtol=1e-6)
    heavier = replace(scaled, fixed=[(make("link_mass", where="torso"), [1.0])])
    np.testing.assert_allclose(received(heavier, **other), [0.0])
    untold = conditioned(-2.0, 2.0, "transforms.with_params.truth=false", how="add")
    assert received(untold, **other) is None
    file.write_text("- {effect: backlash, where: leg_joint, side: link, value: 0.1}\n", "utf-8")
    motor = conditioned(0.0, 0.2, effect="backlash", where="leg_joint", side="motor")
    with pytest.raises(TransferError, match=r"robots.a: backlash.leg_joint .*side=link.*=motor; w"):
        Transfer({"a": other}, 1).check(Motionless(motor))


def test_episodes_on_a_named_robot_show_its_parameters() -> None:
    """The policy acts on the torso's true mass, not on the centre of the range."""
    seen: list[torch.Tensor] = []

    class Noting(Still):
        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            seen.append(observation[:, 11:])
            return super().forward(observation)

    class Conditioned(Motionless):
        def trained(self) -> TrainedPolicy:
            return replace(super().trained(), actor=lambda theta: Acting(Noting()))

    words = ["env=hopper", "params=mass_friction", "transforms=with_params"]
    world = environment_of(compose([*words, "env.task.max_steps=5"]))
    Transfer({"target": {}}, episodes=2).assess(Conditioned(world), 0, "seed 0")
    torch.testing.assert_close(
        torch.cat(seen)[:, 0].unique(), torch.tensor([-0.3336]), atol=1e-3, rtol=0
    )
    assert len(torch.cat(seen)) == 2 * len(seen) > 0


def test_files_hold_every_episode(tmp_path: Path) -> None:
    """What is read equals what was written, under a name that says the steps."""
    transfer, scores = Transfer(ROBOTS, episodes=4), assess(env())
    transfer.report([scores], 0, tmp_path)
    (back,) = read(tmp_path / "transfer-4096.json")
    for robot in ROBOTS:
        np.testing.assert_allclose(back.returns[robot], scores.returns[robot], atol=1e-6)
        np.testing.assert_array_equal(back.lengths[robot], scores.lengths[robot])
    assert (back.trained_on, back.frames, back.robots) == ("source", 4096, ROBOTS)
    assert "| seed 0 | source (its own) |" in (tmp_path / "transfer.md").read_text("utf-8")


def test_mistakes_are_sentences(tmp_path: Path) -> None:
    """An argument or a value that a task does not take, a world without a task, a torn file."""
    match = r"eval\.robots\.a: .*does not accept 'domian' \(did you mean 'dom"
    with pytest.raises(TransferError, match=match):
        assess(env(), a={"domian": "target"})
    with pytest.raises(TaskError, match=r"domain='targte'.*did you mean 'target'"):
        assess(env(), a={"domain": "targte"})
    with pytest.raises(TransferError, match=r"Nav2D has no task .*env=hopper_polito"):
        assess(EnvironmentFactory(partial(ToyEnv, Nav2D)))
    with pytest.raises(TransferError, match="at least one robot"):
        Transfer({}, episodes=4)
    (tmp_path / "transfer-1.json").write_text('{"runs": [{"name"')
    with pytest.raises(TransferError, match="is incomplete or damaged"):
        read(tmp_path / "transfer-1.json")


def test_the_robots_of_a_configuration_are_simulated() -> None:
    """What Hydra's tree describes can be another robot, too, and keeps its name."""
    _, given = instantiate(compose(["+experiment=ppo_source"]), Path())
    world = given["parts"].environment
    other = env_with_robot(world, "light", {"max_steps": 100})
    assert other.simulated and other.name == world.name
    assert other.task is not None and other.task.max_steps == 100
