"""The gap as given: errors of all rows, their noise, and blocks that say how sure a size is.

    baseline = Baseline.of(replayer, floors, rng)
    baseline.blocks.rms(baseline.errors)

Sizes of gaps are root mean squares over all compared rows, in the units of errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.score import Blocks, coherence
from sim2real.diagnosis.evidence import Band
from sim2real.diagnosis.inference.hypotheses import NONE
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.locate import as_gaps, bands, locate
from sim2real.diagnosis.schema import JointGap
from sim2real.runs.errors import Sim2RealError


@dataclass(frozen=True)
class Baseline:
    """What the model as given leaves."""

    data: Data
    errors: np.ndarray  # (W, T, M) simulated minus measured, over the joints' scale
    floors: np.ndarray  # (M,) noise floor of each joint [rad or m]
    blocks: Blocks  # of all windows

    @staticmethod
    def of(replayer: Replayer, rng: np.random.Generator) -> Baseline:
        """Return the baseline of a replayer's windows.

        Raises:
            Sim2RealError: the model as given diverges.
        """
        data, count = replayer.data, len(replayer.every)
        errors, lost = replayer.follow(NONE, np.zeros((count, 0)))
        _refuse_lost(data, lost)
        blocks = Blocks(data, rng, coherence(data, errors))
        return Baseline(data, errors, data.floors(), blocks)

    @property
    def before(self) -> float:
        """The size of the gap."""
        return self.blocks.rms(self.errors)

    @property
    def floor(self) -> float:
        """The size of what noise alone leaves."""
        return float(np.sqrt(np.mean((self.floors / self.data.scale) ** 2)))

    def closed(self, errors: np.ndarray) -> tuple[float, tuple[float, float]]:
        """Return the share of the closable gap that other errors close, and its 90 % interval."""
        return self.blocks.closed(self.errors, errors, self.floor)

    def locate(
        self, after: np.ndarray | None, rng: np.random.Generator
    ) -> tuple[tuple[JointGap, ...], tuple[Band, ...]]:
        """Return where the gap lies, by joint and kind of moment, and by frequency.

        `after` are errors with the causes, (W, T, M); None where there are none.
        """
        data, settings = self.data, self.data.settings
        floors, scale, models = self.floors, data.scale, data.log_models
        gaps = as_gaps(data, self.errors)
        later = [] if after is None else as_gaps(data, after)
        where = locate(gaps, floors, models, later, rng=rng, scale=scale, settings=settings)
        return where, bands(gaps, floors, later, settings.locating)


def _refuse_lost(data: Data, lost: np.ndarray) -> None:
    """Raise Sim2RealError if the model as given cannot follow the logs, (W,) s until it is lost."""
    if np.isfinite(lost).any():
        first = int(np.argmax(np.isfinite(lost)))
        window = data.windows[first]
        path = data.logs[window.log].path or "the log"
        moment = data.logs[window.log].time[window.first] + float(lost[first])
        raise Sim2RealError(
            f"{path}, episode {window.episode}: the model cannot follow the log; it diverges at "
            f"about {moment:.2f} s; try a smaller timestep, or check masses, gains and units"
        )
