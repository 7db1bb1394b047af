"""The robot of a deployment, and the picture of its returns."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib.figure
import numpy as np
import pytest
import yaml

from hardware.config import ROBOTS
from hardware.errors import RobotError
from sim2real.deployment.deploy import draw
from sim2real.deployment.record import configure_robot


def test_an_empty_port_is_not_the_emulated_robot() -> None:
    """A shell's variable that is not set is a mistake, of the servos' port and of the IMU's."""
    robot = yaml.safe_load((ROBOTS / "quad8.yaml").read_text(encoding="utf-8"))
    assert configure_robot(robot, None, None).port is None
    with pytest.raises(RobotError, match=r"quad8: port= is empty; .* leave it out for the emulat"):
        configure_robot(robot, "", None)
    with pytest.raises(RobotError, match="quad8: imu_port= is empty; give a port"):
        configure_robot(robot, None, None, "")


def test_the_best_so_far_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Adapting tries worse policies too: a line says what the best of them has earned so far."""
    shown: list[Any] = []
    save = matplotlib.figure.Figure.savefig

    def keep(self: Any, *args: Any, **kwargs: Any) -> None:
        shown.append(self)
        save(self, *args, **kwargs)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)
    rows = SimpleNamespace(log=SimpleNamespace(last=None))
    returns = SimpleNamespace(before=[1.0, 1.1], adapting=[0.5, 1.4, 0.9, 1.5], after=[1.5])
    draw(rows, returns, tmp_path)  # type: ignore[arg-type]
    (axes,) = shown[0].axes
    lines = {line.get_label(): np.asarray(line.get_xydata()) for line in axes.lines}
    assert lines["best so far"].tolist() == [[3, 0.5], [4, 1.4], [5, 1.4], [6, 1.5]]
    assert lines["adapting"][:, 1].tolist() == [0.5, 1.4, 0.9, 1.5]
    assert (tmp_path / "returns.png").stat().st_size > 5000
