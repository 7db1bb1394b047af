"""What every test can rely on: one thread, pictures without a screen, skips that say why."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch and numpy are imported
os.environ.setdefault("MPLBACKEND", "Agg")

import gc
import signal
import sys
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import pytest
from hydra._internal.config_repository import ConfigRepository
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig

from sim2real.config import compose, extensions, signatures
from sim2real.config.catalogue import CONF
from sim2real.config.hydra_compose import hydra_compose

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.set_threshold(50_000, 20, 100)  # the usual 700 objects cost a twentieth of the suite's time

LOADED: dict[str, ConfigResult | None] = {}  # files of conf/ and Hydra's own: no test changes them
load_config = ConfigRepository.load_config


def _load_once(self: ConfigRepository, config_path: str) -> ConfigResult | None:
    """Read a file for Hydra: two fifths of the 0.17 s that a composition takes."""
    if {source.path for source in self.sources} - {str(CONF), "hydra.conf", ""}:  # a user's folder
        return load_config(self, config_path)
    if config_path not in LOADED:
        LOADED[config_path] = load_config(self, config_path)
    found = LOADED[config_path]
    if found is None or ("/" in config_path and found.header["package"] != "_global_"):
        return found  # Hydra copies what it puts into a group
    return replace(found, config=deepcopy(found.config))


@lru_cache(maxsize=32)
def _composed_once(*overrides: str) -> DictConfig:
    """Compose a command line, which nothing changes once it is composed."""
    return hydra_compose(list(overrides))


def _composed(overrides: list[str]) -> DictConfig:
    return hydra_compose(overrides) if extensions.folder() else _composed_once(*overrides)


ConfigRepository.load_config = _load_once
compose.hydra_compose = _composed


@pytest.fixture(autouse=True)
def _no_folder_stays_in_use() -> Iterator[None]:
    """What a test puts in reach with `--config-dir` is out of reach of those after it."""
    path, variable = list(sys.path), os.environ.get(extensions.VARIABLE)
    yield
    if signatures.OWN:
        for name in signatures.OWN:
            sys.modules.pop(name, None)
        signatures.OWN.clear()
        signatures.clear_cache()
        sys.path[:] = path
    if variable is None:
        os.environ.pop(extensions.VARIABLE, None)


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what all tests import."""
    gc.freeze()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test whose machine, robot or library is not there."""
    if item.get_closest_marker("gpu"):
        import torch

        if not torch.cuda.is_available():
            pytest.skip("needs a CUDA device")
    if item.get_closest_marker("hardware") and "SIM2REAL_PORT" not in os.environ:
        pytest.skip("needs a robot; name its serial port in SIM2REAL_PORT")
    if item.get_closest_marker("render"):
        from envs.errors import RenderError
        from envs.pixels.library import library

        try:
            library()
        except RenderError as error:
            pytest.skip(str(error))
