"""A fault of MuJoCo 4.0.0 in its sparse Cholesky factorization, and who meets it.

4.0.0 merges rows with different descendants into one supernode. Where the constraint Jacobian is
sparse, the Newton solver then gets a wrong factor of its Hessian: it converges slowly, to wrong
accelerations, or diverges (https://github.com/google-deepmind/mujoco/issues/3767). 4.0.1 fixes it.
A Jacobian is sparse where the model asks for it, or from 60 degrees of freedom on.
"""

import functools
import logging

import mujoco

FAULTY = "4.0.0"
_logger = logging.getLogger(__name__)


def has_sparse_fault(model: mujoco.MjModel) -> bool:
    """Return whether the installed engine may solve this model's constraints wrongly."""
    newton = model.opt.solver == mujoco.mjtSolver.mjSOL_NEWTON
    return mujoco.__version__ == FAULTY and newton and bool(mujoco.mj_isSparse(model))


def warn_of_sparse_fault(model: mujoco.MjModel) -> None:
    """Log the fault and its remedy if a model can meet it, once for each number of freedoms."""
    if has_sparse_fault(model):
        _warn(model.nv)


@functools.cache
def _warn(freedoms: int) -> None:
    _logger.warning(
        "MuJoCo %s solves models whose constraint Jacobian is sparse wrongly, such as this one "
        "with %d degrees of freedom: install mujoco>=4.0.1, or set "
        '<option jacobian="dense"/> in the model',
        mujoco.__version__,
        freedoms,
    )
