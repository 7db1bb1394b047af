"""Images by OpenGL, off screen, on every core.

A software renderer draws on one core, so each core gets a process with a share of the
rows. Positions and what effects change of the model's looks go to them, and images come back,
through files in memory. What costs most where the CPU draws is left out: shadows, reflections,
smoothing, fine meshes (25 times the speed of the default settings).
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, cast

import mujoco
import numpy as np

from envs.errors import RenderError
from envs.pixels.base import Renderer
from envs.pixels.library import INSTALL, library
from envs.pixels.worker import LOOKS, READY, STATE, map_array
from envs.simulation import Simulation

MEMORY = Path("/dev/shm")  # a folder whose files are memory, where there is one


class GLRenderer(Renderer):
    """Draws by OpenGL; see the module's text and `Renderer`.

    Args:
        simulation: whose rows are drawn.
        size: the side of the square images [px].
        camera: the name of one of the model's cameras; None: that of the task.
        processes: that draw; None for one a core.

    Raises:
        TaskError: a size out of range, or a camera that the model lacks.
        RenderError: when nothing can be drawn on this machine.
    """

    def __init__(
        self,
        simulation: Simulation,
        size: int,
        camera: str | None = None,
        processes: int | None = None,
    ) -> None:
        super().__init__(simulation, size, camera)
        name = library()
        rows = self.plant.num_rows
        workers = max(1, min(rows, processes or len(os.sched_getaffinity(0))))
        self._folder = tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None)
        folder = Path(self._folder.name)
        mujoco.mj_saveModel(self.model, str(folder / "model.mjb"))
        self._image = map_array(folder, "image", (rows, size, size, 3), np.uint8)
        self._state = {}
        for field, bound in zip(STATE, self.watch(*STATE), strict=True):
            if bound.size:
                self._state[field] = bound, map_array(folder, field, bound.shape, None)
        self._looks = {
            field: map_array(folder, field, (rows, *np.shape(getattr(self.model, field))), None)
            for field in LOOKS
            if self.plant.is_field_written(field)
        }
        command = [sys.executable, "-m", "envs.pixels.worker", name, str(folder)]
        command += [str(rows), str(size), str(self.camera), *self._looks]
        self._workers = [self._start(command) for _ in range(workers)]
        for worker in self._workers:
            self._expect(worker)

    def _start(self, command: list[str]) -> subprocess.Popen[bytes]:
        root = str(Path(__file__).resolve().parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
        environment = os.environ | {"LP_NUM_THREADS": "0", "PYTHONPATH": path}  # Mesa: one core
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
        )

    def _expect(self, worker: subprocess.Popen[bytes]) -> None:
        if cast(IO[bytes], worker.stdout).read(len(READY)) != READY:
            self.close()
            raise RenderError(
                f"a drawing process ended with code {worker.returncode} ({library()}); {INSTALL},"
                " or use renderer=rays, which needs none"
            )

    def render(self, ids: np.ndarray | None) -> np.ndarray:
        """Draw the rows ids; see `Renderer.render`.

        Raises:
            RenderError: a drawing process that died, or a renderer that was closed.
        """
        if self.closed:
            raise RenderError("this renderer is closed; make a new one")
        rows = np.arange(self.plant.num_rows) if ids is None else np.asarray(ids)
        for bound, values in self._state.values():
            values[rows] = bound[rows]
        for field, values in self._looks.items():
            values[rows] = self.plant.field_values(field, rows)
        busy = []
        for worker, share in zip(
            self._workers, np.array_split(rows, len(self._workers)), strict=True
        ):
            if share.size:
                self._ask(worker, share)
                busy.append(worker)
        for worker in busy:
            self._expect(worker)
        return np.array(self._image[rows])

    def _ask(self, worker: subprocess.Popen[bytes], rows: np.ndarray) -> None:
        pipe = cast(IO[bytes], worker.stdin)
        try:
            pipe.write(np.array([len(rows), *rows], np.int64).tobytes())
            pipe.flush()
        except BrokenPipeError:
            pass  # reading its answer reports that it is gone

    def close(self) -> None:
        """End the drawing processes and free the memory."""
        if self.closed:
            return
        super().close()
        for worker in self._workers if hasattr(self, "_workers") else []:
            worker.kill()
            worker.wait()
            for pipe in (worker.stdin, worker.stdout):
                if pipe is not None:
                    pipe.close()
        self._folder.cleanup()

    def __del__(self) -> None:
        if not getattr(self, "closed", True):
            self.close()
