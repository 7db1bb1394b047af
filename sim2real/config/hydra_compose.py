"""Compose overrides by Hydra: the tree of conf/ and of a user's own folder, unchecked.

composed(["+experiment=smoke", "seed=3"]).seed
"""

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig

from sim2real.config import extensions
from sim2real.config.arguments import path_value
from sim2real.config.catalogue import CONF


def hydra_compose(overrides: list[str]) -> DictConfig:
    """Compose a configuration, also within a job that Hydra runs, whose own state stays as it is.

    Args:
        overrides: overrides as on the command line.

    Raises:
        HydraException: a name or a value that is not there.
    """
    own = extensions.folder()
    path = [] if own is None else [f"hydra.searchpath=[{path_value(f'file://{own}')}]"]
    running = GlobalHydra.instance().hydra  # `contract` composes what a log's policy was
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            return compose("config", [*overrides, *path])
    finally:
        GlobalHydra.instance().hydra = running
