"""DROPO finds the Gaussian that transitions were drawn from: on a batched toy, on public data."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.distribution import Distribution, Entry
from envs.effects import make
from envs.marginals import uniform
from envs.models import named
from envs.tasks import Hopper
from hardware.log import Log
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.dropo import Dropo
from sim2real.identification.providers.base import AlignedProvider
from sim2real.identification.providers.replay import replay
from sim2real.identification.searches import Cma
from sim2real.runs.errors import Sim2RealError

DATA = os.environ.get("SIM2REAL_DATA")
PUBLIC = Path(DATA or ".") / "hopper_transitions" / "hopper10000.npz"


class Carts(AlignedProvider):
    """Two carts, pushed once each: speeds change by force over mass."""

    def __init__(self, masses: np.ndarray, rng: np.random.Generator, noise: float = 0.0) -> None:
        count = len(masses)
        self._force = rng.uniform(0.5, 2.0, masses.shape) * rng.choice([-1, 1], masses.shape)
        self._real = (self._force / masses)[:, None]  # (W, 1, 2)
        self._real = self._real + noise * rng.normal(size=self._real.shape)
        floor = np.full(2, noise)
        super().__init__(self._real, np.arange(count), np.ones(2), ["a", "b"], floor, np.ones(2))

    def errors_of(self, pieces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return simulated minus measured."""
        return (self._force[pieces] / values)[:, None] - self._real[pieces]


def masses(*bodies: str, low: float = 0.3, high: float = 3.0) -> Distribution:
    """Return a prior over factors of masses."""
    return Distribution(
        tuple(Entry(make("link_mass", where=b, how="scale"), (uniform(low, high),)) for b in bodies)
    )


@pytest.mark.slow
def test_a_known_gaussian_is_recovered() -> None:
    """Masses N(1.5, 0.2) and N(0.9, 0.05): means within 5 %, deviations within a quarter."""
    rng = np.random.default_rng(0)
    drawn = rng.normal([1.5, 0.9], [0.2, 0.05], (400, 2))
    method = Dropo(Cma(population=12, generations=60), samples=60, noise=0.01)
    found = method.found(Carts(drawn, rng), masses("a", "b"), FitContext())
    assert found.mean == pytest.approx(drawn.mean(axis=0), rel=0.05)
    assert found.columns("spread") == pytest.approx(drawn.std(axis=0), rel=0.25)
    np.testing.assert_array_equal(found.std, found.columns("spread"))


def test_one_robot_has_a_narrow_gaussian() -> None:
    """Where all transitions are of one mass, the deviation falls to what noise hides."""
    rng = np.random.default_rng(0)
    carts = Carts(np.full((300, 2), 1.2), rng, noise=0.01)
    found = Dropo(Cma(population=12, generations=60), samples=40).found(
        carts, masses("a", "b"), FitContext()
    )
    assert found.mean == pytest.approx([1.2, 1.2], rel=0.02)
    assert (found.std < 0.02).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [({"rows": 0}, "rows=0"), ({"noise": 0.0}, "noise=0"), ({"narrowest": 0.6}, "below widest")],
    ids=["rows", "noise", "narrowest"],
)
def test_numbers_out_of_range_are_refused(given: dict, message: str) -> None:
    """A sentence with the value."""
    with pytest.raises(Sim2RealError, match=message):
        Dropo(Cma(), **given)


def hopper_log(folder: Path, count: int) -> Log:
    """Return the public transitions as episodes of two rows, of the hopper of our task."""
    spec = named(Hopper().spec())
    (folder / "hopper.xml").write_text(spec.to_xml(), encoding="utf-8")
    model = spec.compile()
    with np.load(PUBLIC) as table:
        here, action, after = (table[k][:count] for k in ("obs", "act", "next_obs"))
    both = np.stack([here, after], axis=1).reshape(2 * count, -1)
    dt = Hopper().frame_skip * model.opt.timestep
    columns = {"episode": np.repeat(np.arange(count), 2), "time": np.tile([0.0, dt], count)}
    names = [model.joint(i).name for i in range(model.njnt)]
    columns[f"qpos.{names[0]}"] = np.zeros(2 * count)
    columns |= {f"qpos.{n}": both[:, i] for i, n in enumerate(names[1:])}
    columns |= {f"qvel.{n}": both[:, len(names) - 1 + i] for i, n in enumerate(names)}
    for i in range(model.nu):
        columns[f"ctrl.{model.actuator(i).name}"] = np.repeat(action[:, i], 2)
    return Log(columns, {"model": str(folder / "hopper.xml")}, folder / "hopper.csv")


@pytest.mark.slow
@pytest.mark.skipif(
    not PUBLIC.is_file(), reason=f"public transitions: set SIM2REAL_DATA ({PUBLIC})"
)
def test_masses_of_the_public_hopper(tmp_path: Path) -> None:
    """The torso of the public transitions is heavier or lighter than ours, the rest is the same."""
    data = Recordings([hopper_log(tmp_path, 300)])
    prior = masses("torso", "thigh", "leg", "foot", low=0.5, high=2.0)
    method = Dropo(Cma(population=10, generations=40), samples=10, transitions=150)
    found = method.fit(replay, prior, data)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "hopper.xml")).nu == 3
    assert (np.abs(found.mean[1:] - 1.0) < 2 * found.std[1:] + 0.1).all()
    assert found.std[0] < 0.2
