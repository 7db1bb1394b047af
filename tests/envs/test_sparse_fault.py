"""The fault of MuJoCo 4.0.0: it is there where the warning says, and nowhere else."""

import logging

import mujoco
import numpy as np
import pytest

from envs import sparse_fault
from envs.plant import Plant


def chains(jacobian: str, branches: int = 3) -> str:
    """Return three trees of bodies, each dividing twice, that fall and meet their limits."""

    def link(depth: int, number: int) -> str:
        parts = branches if depth % 2 else 1
        rest = "".join(link(depth - 1, number + i + 1) for i in range(parts)) if depth > 1 else ""
        return f"""<body pos="0.1 {0.05 * number} 0"><joint axis="0 1 0" damping="0.1"
          range="-20 20" frictionloss="0.05"/>
          <geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.02"/>{rest}</body>"""

    trees = (
        f'<body pos="{0.3 * i} 0 0.1"><freejoint/><geom size="0.05"/>{link(3, 0)}</body>'
        for i in range(3)
    )
    return f"""<mujoco><option jacobian="{jacobian}"/><worldbody>
      <geom type="plane" size="5 5 0.1"/>{"".join(trees)}</worldbody></mujoco>"""


def fallen(jacobian: str) -> np.ndarray:
    """Return the positions after 0.2 s, (nq,)."""
    model = mujoco.MjModel.from_xml_string(chains(jacobian))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    return data.qpos.copy()


def test_the_installed_engine_has_the_fault_if_it_is_called_faulty() -> None:
    """A sparse Jacobian moves the model otherwise than a dense one, or to the same place."""
    apart = np.abs(fallen("sparse") - fallen("dense")).max()
    model = mujoco.MjModel.from_xml_string(chains("sparse"))
    assert sparse_fault.has_sparse_fault(model) == (apart > 1e-3)


@pytest.mark.parametrize("jacobian", ["sparse", "dense"])
def test_a_plant_says_so_once(jacobian: str, monkeypatch, caplog) -> None:
    """With the remedy, for a sparse model of the faulty engine alone."""
    monkeypatch.setattr(mujoco, "__version__", sparse_fault.FAULTY)
    sparse_fault._warn.cache_clear()
    spec = mujoco.MjSpec.from_string(chains(jacobian))
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            Plant(spec, [], 1, 1)
    said = [record.getMessage() for record in caplog.records if "Jacobian" in record.getMessage()]
    assert len(said) == (jacobian == "sparse")
    assert all("mujoco>=4.0.1" in text and 'jacobian="dense"' in text for text in said)


def test_a_mended_engine_and_another_solver_have_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """4.0.1 is not warned of, and neither is the conjugate gradient."""
    model = mujoco.MjModel.from_xml_string(chains("sparse"))
    monkeypatch.setattr(mujoco, "__version__", "4.0.1")
    assert not sparse_fault.has_sparse_fault(model)
    monkeypatch.setattr(mujoco, "__version__", sparse_fault.FAULTY)
    assert sparse_fault.has_sparse_fault(model)
    model.opt.solver = mujoco.mjtSolver.mjSOL_CG
    assert not sparse_fault.has_sparse_fault(model)
