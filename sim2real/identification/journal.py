"""Record a search's evaluations, so that a stopped run can resume.

    journal = Journal(folder / "journal.npz", score)
    numbers = journal.evaluate(points, turn, evaluate)  # recorded ones if these points were asked

A search is a pure function of its seed and of the numbers that it receives. A resumed run therefore
asks the same points and receives the recorded numbers, without a simulation, until it reaches the
point where it was stopped; the score's learned state is loaded there. The file is whole or absent
and holds arrays only.
"""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from hardware.files import atomic_write
from sim2real.identification.scores.base import Score
from sim2real.identification.searches import Evaluate
from sim2real.runs.errors import Sim2RealError

STATE = "score."  # what the names of a score's arrays begin with


class Journal:
    """The generations of a search.

    Args:
        path: the file; None keeps nothing.
        score: whose memory is kept along; None where it has none.
        start: the journal of a run to go on from; None starts a new one.

    Raises:
        Sim2RealError: a journal that is damaged.
    """

    def __init__(
        self, path: Path | None, score: Score | None = None, start: Path | None = None
    ) -> None:
        self.path, self.score = path, score
        self._asked: list[np.ndarray] = []
        self._told: list[np.ndarray] = []
        self._state: dict[str, np.ndarray] = {}
        self._known = 0
        if start is not None:
            self._read(start)

    def _read(self, start: Path) -> None:
        try:
            with np.load(start, allow_pickle=False) as arrays:
                held = {name: arrays[name] for name in arrays.files}
        except FileNotFoundError:
            raise Sim2RealError(
                f"resume: no {start}; give the folder of a run of identify"
            ) from None
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            raise Sim2RealError(
                f"resume: {start} is damaged ({error}); start again without resume"
            ) from None
        self._known = len([name for name in held if name.startswith("asked.")])
        self._asked = [held[f"asked.{i}"] for i in range(self._known)]
        self._told = [held[f"told.{i}"] for i in range(self._known)]
        self._state = {n.removeprefix(STATE): a for n, a in held.items() if n.startswith(STATE)}

    def evaluate(self, points: np.ndarray, turn: int, evaluate: Evaluate) -> np.ndarray:
        """Return the points' numbers, (n,): those that are recorded, or new ones, which are kept.

        Raises:
            Sim2RealError: a journal of another search.
        """
        if turn < self._known:
            if not np.array_equal(self._asked[turn], points):
                raise Sim2RealError(
                    f"resume: generation {turn + 1} evaluated other points: settings, seed, logs "
                    f"or prior have changed; start again without resume"
                )
            if turn == self._known - 1 and self.score is not None:
                self.score.load(self._state)
            return self._told[turn]
        numbers = evaluate(points, turn)
        self._asked.append(points)
        self._told.append(numbers)
        self._write()
        return numbers

    def _write(self) -> None:
        if self.path is None:
            return
        arrays: dict[str, Any] = {f"asked.{i}": a for i, a in enumerate(self._asked)}
        arrays |= {f"told.{i}": a for i, a in enumerate(self._told)}
        if self.score is not None:
            arrays |= {STATE + name: a for name, a in self.score.state().items()}
        with atomic_write(self.path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays)
