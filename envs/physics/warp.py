"""MuJoCo Warp: float32 on a GPU, or slowly on its CPU device.

A control step of all rows is one CUDA graph. The first use of a model compiles its kernels, which
takes a minute; later ones load them from a cache inside the virtual environment. MuJoCo Warp raises
no warnings: a row is broken when its state is not finite or larger than `mjMAXVAL`, as MuJoCo's own
checks say, or when it had more constraints than there is room for.
"""

import logging
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from envs.errors import TaskError
from envs.physics.arrays import Arrays
from envs.physics.base import Engine

LOG = logging.getLogger(__name__)
NEEDED = ("torch", "warp", "mujoco_warp", "array_api_compat")
MODULES = (*NEEDED[:3], "array_api_compat.torch")
STATE = ("time", "qpos", "qvel", "act", "history", "qacc_warmstart", "ctrl", "qfrc_applied")
CONSTRAINTS = 64  # of contacts, a world: 16 contacts of three dimensions; limits and friction add


class WarpPhysics:
    """Steps copies of a batch's simulations on a device.

    Args:
        batch: the simulations, as parameters and starts have them.
        device: `cpu`, `cuda` or `cuda:1`.

    Raises:
        TaskError: MuJoCo Warp is not installed, there is no such device, or it cannot step the
            model.
    """

    name: Engine = "warp"

    def __init__(self, batch: Batch, device: Any = "cpu") -> None:
        missing = [name for name in NEEDED if find_spec(name) is None]
        if missing:
            raise TaskError(
                f"physics=warp needs {', '.join(missing)}: pip install 'sim2real[train,gpu]', or "
                "use physics=batch"
            )
        modules: list[Any] = [import_module(name) for name in MODULES]
        torch, warp, mujoco_warp, xp = modules
        place = torch.device(device)
        if place.type not in ("cpu", "cuda") or (
            place.type == "cuda" and not torch.cuda.is_available()
        ):
            raise TaskError(
                f"physics=warp runs on cuda or cpu, but device={device} is not there; "
                "use one of them, or physics=batch"
            )
        self._torch, self._wp, self._mjw, self._batch = torch, warp, mujoco_warp, batch
        warp.config.log_level = warp.LOG_WARNING
        if "WARP_CACHE_PATH" not in os.environ:
            warp.config.kernel_cache_dir = str(Path(sys.prefix, "cache", "warp"))
        self.arrays = Arrays(xp, torch.float32, place)
        warp.init()
        if place.type == "cuda" and place.index is None:
            place = torch.device("cuda", torch.cuda.current_device())
        self._device = warp.device_from_torch(place)
        limited = int(batch.model.jnt_limited.sum())
        room = CONSTRAINTS + batch.model.nv + limited + 6 * batch.model.neq
        with warp.ScopedDevice(self._device), _refusals():
            self._data = mujoco_warp.make_data(batch.model, nworld=batch.nsim, njmax=room)
        self._model: Any = None  # made when the fields are known that effects write
        self._shared = set(MODEL_FIELDS)  # fields of which there is one for all rows
        self._graphs: dict[int, Any] = {}
        self._fields: list[tuple[Any, np.ndarray]] = []  # (N, k) here, (N, ...) in the batch
        self._states = [(self._flat(getattr(self._data, n)), batch.bind(n)) for n in STATE]
        self._bound: dict[str, tuple[Any, np.ndarray]] = {}  # what is one substep old
        self._moving = [
            view
            for (view, _), n in zip(self._states, STATE, strict=True)
            if n not in ("ctrl", "qfrc_applied") and view.shape[1]
        ]
        self._checked = [self._flat(getattr(self._data, n)) for n in ("qpos", "qvel", "qacc")]
        self._overflow = warp.to_torch(self._data.overflow)

    def _flat(self, array: Any) -> Any:
        """Return a view (N, k) of a Warp array (N, ...)."""
        view = self._wp.to_torch(array)
        return view.reshape(view.shape[0], int(np.prod(view.shape[1:])))

    def bind(self, name: str) -> Any:
        """Return a live tensor (N, ...) over a field of the device's data."""
        own = getattr(self._data, name)
        if name not in STATE and name not in self._bound:
            self._bound[name] = self._flat(own), self._batch.bind(name)
        return self._wp.to_torch(own)

    def field(self, name: str, own: np.ndarray) -> Any:
        """Return a live tensor (N, ...) over a field of the device's model."""
        return self._wp.to_torch(getattr(self._model, name)).view(own.shape)

    def _build(self) -> None:
        """Make the model and compile its kernels."""
        wp, mjw = self._wp, self._mjw
        with wp.ScopedDevice(self._device), _refusals():
            self._model = mjw.put_model(self._batch.model)
        self._model.opt.warn_overflow = 0
        self._widen(MODEL_FIELDS)
        every = np.arange(self._batch.nsim)
        self._put(every, self._states)
        LOG.info("MuJoCo Warp compiles its kernels: about a minute the first time")
        with wp.ScopedDevice(self._device):
            mjw.step(self._model, self._data)
        self._put(every, self._states)

    def _widen(self, names: Iterable[str]) -> None:
        """Give the model a copy per row of fields that differ between rows from now on."""
        wp, model, wide = self._wp, self._model, []
        for name in self._shared.intersection(names):
            values = self._batch.expanded(name)
            if values is None:
                continue
            self._shared.remove(name)
            owner, own = (model.opt, name[4:]) if name.startswith("opt.") else (model, name)
            shared: Any = getattr(owner, own, None)
            if not getattr(shared, "_is_batched", False):
                if name in mujoco.MjModel._setconst_outputs:
                    continue  # derived for what MuJoCo Warp does otherwise, or for sleeping
                raise TaskError(
                    f"physics=warp has one {name} for all rows, but here the rows differ; use "
                    f"physics=batch"
                )
            shape = (self._batch.nsim, *shared.shape[1:])
            each = wp.empty(shape, dtype=shared.dtype, device=self._device)
            each._is_batched = True
            setattr(owner, own, each)
            wide.append((self._flat(each), values))
        if wide:
            self._graphs.clear()
            self._fields += wide
            self._put(np.arange(self._batch.nsim), wide)

    def _put(self, ids: np.ndarray, pairs: list[tuple[Any, np.ndarray]]) -> None:
        """Copy rows of the batch's arrays (N, ...) to views (N, k), in one transfer."""
        pairs = [(view, host) for view, host in pairs if view.shape[1]]
        if not pairs:
            return
        parts = [host[ids].reshape(len(ids), -1) for _, host in pairs]
        sent = self.arrays.own(np.concatenate(parts, axis=1))
        rows, first = self.arrays.rows(ids), 0
        for view, _ in pairs:
            last = first + view.shape[1]
            view[rows] = sent[:, first:last].to(view.dtype)
            first = last

    def written(self, ids: np.ndarray) -> None:
        """Copy the model's fields of the rows ids (n,) that differ between rows."""
        if self._model is None:
            self._build()
        else:
            self._widen(mujoco.MjModel._setconst_outputs)  # those that `set_const` found to differ
            self._put(ids, self._fields)

    def started(self, ids: np.ndarray) -> None:
        """Copy the states of the rows ids (n,), and what was bound."""
        self._put(ids, [*self._states, *self._bound.values()])
        self._overflow[self.arrays.rows(ids)] = 0

    def step(self, ids: np.ndarray | None, nstep: int) -> None:
        """Advance all rows, and put those that are not among ids back."""
        if ids is None:
            self._run(nstep)
            return
        before = [view.clone() for view in self._moving]
        self._run(nstep)
        stays = np.ones(self._batch.nsim, dtype=bool)
        stays[ids] = False
        kept = self.arrays.own(stays)[:, None]
        for view, old in zip(self._moving, before, strict=True):
            view.copy_(self._torch.where(kept, old, view))

    def _run(self, nstep: int) -> None:
        wp = self._wp
        if not self._device.is_cuda:
            for _ in range(nstep):
                self._mjw.step(self._model, self._data)
            return
        if nstep not in self._graphs:
            with wp.ScopedDevice(self._device), wp.ScopedCapture() as capture:
                for _ in range(nstep):
                    self._mjw.step(self._model, self._data)
            self._graphs[nstep] = capture.graph
        stream = wp.stream_from_torch(self._torch.cuda.current_stream(self.arrays.device))
        wp.capture_launch(self._graphs[nstep], stream=stream)

    def broken(self, rows: Any) -> Any:
        """Return which of the rows are not finite or too large, or had no room, (n,) bool."""
        ok = self._overflow[rows] == 0
        for view in self._checked:
            ok &= view[rows].abs().amax(1) < mujoco.mjMAXVAL  # false for NaN, too
        return ~ok


@contextmanager
def _refusals() -> Iterator[None]:
    """Turn what MuJoCo Warp says of a model that it cannot step into a TaskError."""
    try:
        yield
    except (NotImplementedError, ValueError) as error:
        raise TaskError(
            f"physics=warp cannot step this model: {error}; use physics=batch"
        ) from error
