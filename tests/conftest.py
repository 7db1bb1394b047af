"""What every test can rely on: one thread, pictures without a screen, skips that say why."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch and numpy are imported
os.environ.setdefault("MPLBACKEND", "Agg")

import copy
import gc
import signal
import sys
from collections.abc import Iterator
from functools import lru_cache

import pytest
from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra.plugins.config_source import ConfigResult
from omegaconf import DictConfig

from sim2real.config import compose, extensions, signatures
from sim2real.config.catalogue import CONF
from sim2real.config.hydra_compose import hydra_compose

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.set_threshold(50_000, 20, 100)  # the usual 700 objects cost a twentieth of the suite's time

PARSED: dict[str, ConfigResult] = {}  # the files of conf/, which no test changes
load_config = FileConfigSource.load_config


def _parsed_once(self: FileConfigSource, config_path: str) -> ConfigResult:
    """Read a file of conf/ for Hydra: a fifth of the 0.17 s that a composition takes."""
    if self.path != str(CONF):
        return load_config(self, config_path)
    if config_path not in PARSED:
        PARSED[config_path] = load_config(self, config_path)
    result = copy.copy(PARSED[config_path])
    result.config = copy.deepcopy(result.config)  # Hydra takes its defaults list out of it
    return result


@lru_cache(maxsize=32)
def _composed_once(*overrides: str) -> DictConfig:
    """Compose a command line, which nothing changes once it is composed."""
    return hydra_compose(list(overrides))


def _composed(overrides: list[str]) -> DictConfig:
    return hydra_compose(overrides) if extensions.folder() else _composed_once(*overrides)


FileConfigSource.load_config = _parsed_once
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
