"""The environment of a run: its transforms, its robots, and what does not fit together."""

from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import torch
from tensordict import TensorDictBase
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase, RewardScaling, StepCounter

from envs import Hopper, MujocoEnv
from envs.errors import EffectError, ParameterError, TaskError
from envs.params import ParamSpace
from envs.torch_env import RandomizeParams
from envs.toys import AngleBias, BiasedCartPole, Nav2D, ToyEnv
from sim2real.config.compose import compose, instantiate
from sim2real.learning.algorithms.base import build
from sim2real.learning.environment import EnvironmentFactory, make_env
from sim2real.learning.transforms import RunningNorm
from sim2real.runs.errors import Sim2RealError

HOPPER = EnvironmentFactory(partial(MujocoEnv, task=Hopper()))


def test_effects_of_a_file_change_the_simulator(tmp_path: Path) -> None:
    """A kilogram in effects.yaml is a kilogram in every row of the environment."""
    path = tmp_path / "effects.yaml"
    path.write_text("- {effect: link_mass, where: torso, value: 1.0}\n", encoding="utf-8")
    rows, plain = HOPPER.with_effects(path).base_rows(3), HOPPER.with_effects(None).base_rows(3)
    torso = plain.plant.model.body("torso").id
    masses = rows.plant.batch.expand("body_mass")[:, torso]
    np.testing.assert_allclose(masses, plain.plant.model.body_mass[torso] + 1.0)


def test_effects_need_a_robot(tmp_path: Path) -> None:
    """A point in the plane has no torso to load, and a missing file is named before work starts."""
    path = tmp_path / "effects.yaml"
    path.write_text("[]", encoding="utf-8")
    with pytest.raises(Sim2RealError, match="Nav2D does not simulate a robot"):
        EnvironmentFactory(partial(ToyEnv, partial(Nav2D))).with_effects(path)
    with pytest.raises(EffectError, match=r"missing\.yaml"):
        HOPPER.with_effects(tmp_path / "missing.yaml")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["algorithm=ppo", "adapt=hillclimb"],
            "PPO cannot train a policy that adapts; use adapt=none",
        ),
        (["policy=gru"], "a GRU needs policy.memory.python_based=true"),
        (["loss=clip_ppo"], "ESMAML does not use loss; remove it, or set loss=none"),
        (["algorithm=ppo", "optimizer=none"], "optimizer=null, but the algorithm needs one"),
        (["transforms=normalized", "advantage=gae"], "a repetition differed: ToyEnv"),
        (["algorithm=ppo_sb3", "transforms=pixels"], "reads 'pixels', which is missing"),
        (["algorithm=ppo_sb3", "policy.in_keys=[image]"], "'image' is not shown"),
    ],
)
def test_parts_that_do_not_go_together_are_refused(words: list[str], sentence, tmp_path) -> None:
    """A part that is not used, one that is missing, entries that are not there: a sentence each."""
    _, given = instantiate(compose(["env=nav2d", "params=goals", *words]), tmp_path)
    with pytest.raises(Sim2RealError, match=sentence):
        build(given["algorithm"], given["parts"])


def test_a_composed_tree_makes_the_environment_that_is_trained_in() -> None:
    """`make_env` gives its transforms, in their order, and its robots."""
    tree = compose(["env=hopper", "params=mass_friction", "algorithm=ppo", "policy=actor_critic"])
    env = make_env(tree, num_envs=3, seed=1)
    chain: Any = env.transform
    names = [type(one).__name__ for one in chain]
    assert names == ["RandomizeParams", "RunningNorm", "RewardScaling"]
    first = env.rollout(3)
    assert first.batch_size == (3, 3) and first["observation"].dtype == torch.float32
    torso = first["params", "link_mass.torso"]
    assert len(torso[:, 0].unique()) == 3 and (torso == torso[:, :1]).all()
    again = make_env(tree, num_envs=3, seed=1).rollout(3)
    torch.testing.assert_close(first["params"], again["params"], atol=0, rtol=0)


class Spring(EnvBase):
    """Somebody else's environment, with a parameter: the reward is the stiffness."""

    def __init__(self, num_envs: int = 1, device: str = "cpu", params: bool = True) -> None:
        super().__init__(device=device, batch_size=torch.Size([num_envs]))
        shape = torch.Size([num_envs, 1])
        self.stiffness = torch.ones(shape)
        self.observation_spec["observation"] = Unbounded(shape)
        if params:
            inner = Composite({"stiffness": Unbounded(shape)}, shape=(num_envs,))
            self.observation_spec["params"] = inner
        self.action_spec, self.reward_spec = Unbounded(shape), Unbounded(shape)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: object) -> TensorDictBase:
        given = None if tensordict is None else tensordict.get("params", None)
        if given is not None:
            self.stiffness = given["stiffness"].clone()
        out = self.observation_spec.zero()
        if "params" in out:
            out["params", "stiffness"] = self.stiffness
        return out.update(self.full_done_spec.zero())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        out = self._reset()
        return out.set("reward", self.stiffness.clone())

    def _set_seed(self, seed: int | None) -> None:
        """Nothing is random."""


class Stiff:
    """Stiffnesses between 2 and 3."""

    effects = ()
    per: Literal["reset", "row"] = "reset"

    def check(self, space: ParamSpace) -> None:
        """Only a spring has one."""
        if space.names != ("stiffness",):
            raise ParameterError("these tasks draw a stiffness")

    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw them."""
        return rng.uniform(2.0, 3.0, (n, 1))


def test_somebody_else_s_environment_is_handed_its_parameters() -> None:
    """Entries ("params", name) of any EnvBase are drawn at each reset."""
    randomize = {"randomize_params": partial(RandomizeParams)}
    env = EnvironmentFactory(partial(Spring), Stiff(), randomize).make(4, seed=3)
    reward = env.rollout(2)["next", "reward"]
    assert ((reward > 2) & (reward < 3)).all() and len(reward.unique()) == 4
    bare = EnvironmentFactory(partial(Spring, params=False), Stiff(), randomize)
    with pytest.raises(TaskError, match=r"entries \('params', name\), which Spring has not"):
        bare.make(4).reset()


def test_what_is_no_environment_or_transform_is_said() -> None:
    """A base of one row, an object that is none, a transform that reads what is not there."""

    class One(Spring):
        def __init__(self, num_envs: int = 1, device: str = "cpu") -> None:
            super().__init__(1, device)

    with pytest.raises(Sim2RealError, match=r"One has batch size \(1,\), asked for \(2,\)"):
        EnvironmentFactory(partial(One)).make(2)
    with pytest.raises(Sim2RealError, match="dict makes a dict, not a torchrl EnvBase"):
        odd_one: Any = partial(dict)
        EnvironmentFactory(odd_one).make(2)
    with pytest.raises(Sim2RealError, match=r"transforms\.x is a int, not a transform"):
        EnvironmentFactory(partial(Spring), transforms={"x": int}).make(2)  # type: ignore[dict-item]
    odd = partial(RewardScaling, 0.0, 1.0, in_keys=["payment"])
    with pytest.raises(Sim2RealError, match=r"transforms\.pay: RewardScaling reads 'payment'"):
        EnvironmentFactory(partial(Spring), transforms={"pay": odd}).make(2)


def test_transforms_of_one_environment_do_not_meet() -> None:
    """Each `make` has its own: what one counts, another does not."""
    transforms = {"norm": RunningNorm, "steps": StepCounter}
    made = EnvironmentFactory(partial(ToyEnv, BiasedCartPole), AngleBias(), transforms)
    one, other = made.make(2), made.make(2)
    assert one.rollout(3)["next", "step_count"].max() == 3
    chains: list[Any] = [one.transform, other.transform]
    counts = [chain.transforms[0].moments["observation"].count for chain in chains]
    assert counts == [2 * (1 + 3), 0]
