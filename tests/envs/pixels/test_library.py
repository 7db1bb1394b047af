"""Which graphics library is found."""

import pytest

from envs.errors import RenderError
from envs.pixels import library


def test_without_a_graphics_library_it_says_what_to_install(monkeypatch) -> None:
    """One line names the package; MUJOCO_GL is named where the user set it."""
    monkeypatch.setattr(library, "_works", lambda name: False)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with pytest.raises(RenderError, match=r"egl and osmesa do not work here; .*apt-get install"):
        library.library.__wrapped__()
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(RenderError, match="MUJOCO_GL=disable turns drawing off"):
        library.library.__wrapped__()
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(library, "_works", lambda name: name == "osmesa")
    assert library.library.__wrapped__() == "osmesa"
