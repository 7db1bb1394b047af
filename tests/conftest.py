"""What every test can rely on: one thread, pictures without a screen, skips that say why."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch and numpy are imported
os.environ.setdefault("MPLBACKEND", "Agg")

import gc
import signal
import sys
from collections.abc import Iterator

import pytest

from sim2real.config import extensions, signatures

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background job
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.set_threshold(50_000, 20, 100)  # the usual 700 objects cost a twentieth of the suite's time


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
