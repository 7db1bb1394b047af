"""The public API works as a person expects, and costs nothing until it is used."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torchrl.envs.utils import check_env_specs

import sim2real
from tests.sim2real.trained import SMALL_PPO, train


def test_names_are_what_they_say() -> None:
    """`diagnose` is the function and no module; every name of __all__ is there."""
    from sim2real import diagnose

    assert diagnose.__module__ == "sim2real.diagnosis.diagnose"
    assert all(getattr(sim2real, name).__name__ == name for name in sim2real.__all__)
    with pytest.raises(AttributeError, match="no attribute 'diagnos'"):
        _ = sim2real.diagnos


def test_an_import_alone_is_light() -> None:
    """Neither torch nor MuJoCo is imported before a name is used; a diagnosis needs no torch."""
    words = "import sys, sim2real; heavy = {'torch', 'mujoco'} & set(sys.modules); "
    words += "from sim2real import diagnose; sys.exit(bool(heavy) or 'torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", words], check=False).returncode == 0


def test_an_environment_of_a_configuration() -> None:
    """make_env gives TorchRL's environment with its transforms; each step knows its robot."""
    config = sim2real.compose(["env=hopper", "params=mass_friction", "transforms=normalized"])
    env = sim2real.make_env(config, num_envs=4, seed=1)
    check_env_specs(env)
    rollout = env.rollout(5, break_when_any_done=False)
    assert rollout["params", "link_mass.torso"].shape == (4, 5)


def test_a_policy_of_a_run(tmp_path: Path) -> None:
    """load_policy needs the run's folder alone, and gives what the training returned."""
    run = train(tmp_path / "run", SMALL_PPO)
    trained = sim2real.load_policy(run)
    size, low, high = trained.environment.observation_and_action_spec()
    action = trained.controller()(np.zeros((1, size)))
    assert action.shape == (1, len(low))
    assert (low <= action).all()
    assert (action <= high).all()
    assert np.isfinite(trained.theta).all()
    assert trained.source is not None
    torch.testing.assert_close(trained.controller()(np.zeros((1, size))), action)
