"""The package's public names."""

import subprocess
import sys

import pytest

import envs


def test_every_public_name_is_there() -> None:
    """Each name of __all__ can be imported from the package; another one cannot."""
    for name in envs.__all__:
        assert getattr(envs, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Hoper'"):
        _ = envs.Hoper


def test_simulating_does_not_import_torch() -> None:
    """The package and its simulations import neither torch nor TorchRL."""
    code = "import envs, sys; envs.Simulation(envs.Hopper()); sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
