"""Emulated robots for the tests of the hardware."""

import copy
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import yaml

from hardware.config import ROBOTS, Robot, make_robot
from hardware.emulator.faults import Fault
from tests.hardware.rig import Rig


def bench_data(count: int = 0, **changes: Any) -> dict[str, Any]:
    """Return the keys of bench1, or of a chain of `count` of its servos."""
    data = yaml.safe_load((ROBOTS / "bench1.yaml").read_text(encoding="utf-8"))
    data |= changes
    if count:
        hinge = {k: v for k, v in data["servos"]["hinge"].items() if k not in data.get("servo", {})}
        servos = {f"hinge{i}": copy.deepcopy(hinge) | {"id": i} for i in range(1, count + 1)}
        data["servos"] = servos
    return data


def many_benches(count: int, option: str) -> str:
    """Return an MJCF of `count` pendulums of 100 g at 0.12 m, with one actuator each."""
    bodies, actuators = [], []
    for i in range(1, count + 1):
        bodies.append(
            f'<body pos="0 {0.1 * i} 0.3"><joint name="hinge{i}" axis="0 -1 0" armature="0.0018"/>'
            '<geom type="sphere" pos="0 0 -0.12" size="0.012" mass="0.1"'
            ' contype="0" conaffinity="0"/></body>'
        )
        actuators.append(f'<position name="hinge{i}" joint="hinge{i}" kp="1.3"/>')
    return (
        f'<mujoco><option integrator="implicitfast" {option}/><worldbody>'
        + "".join(bodies)
        + "</worldbody><actuator>"
        + "".join(actuators)
        + "</actuator></mujoco>"
    )


@pytest.fixture
def chain(tmp_path) -> Callable[..., Robot]:
    """Return a function that makes a robot of `count` pendulums with some keys changed."""

    def make(count: int = 3, option: str = "", **changes: Any) -> Robot:
        path = tmp_path / f"chain{count}.xml"
        path.write_text(many_benches(count, option))
        return make_robot(bench_data(count, model=str(path), name=f"chain{count}", **changes))

    return make


@pytest.fixture(autouse=True)
def nothing_is_left_powered() -> Iterator[None]:
    """End every rig of a test, whatever its fault, and fail if a servo keeps its torque."""
    Rig.made.clear()
    yield
    while Rig.made:
        Rig.made.pop().end()


@pytest.fixture
def rig(chain):
    """Return a function that makes a rig of three servos."""

    def make(*faults: Fault, registers=None, robot=None, **kwargs) -> Rig:
        return Rig(robot or chain(3), faults, registers, **kwargs)

    return make
