"""The logs' commands, replayed: whole windows, or a few rows on from every row's state.

provider = replay(data, effects, rows=None)     # the diagnosis's windows: needs no velocities
provider = replay(data, effects, rows=1)        # one row on: needs the state at every row
"""

from collections.abc import Sequence

import numpy as np

from envs.effects import Effect
from envs.plant import Plant
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.identification.data import Recordings
from sim2real.identification.providers.base import AlignedProvider
from sim2real.identification.providers.steps import Steps
from sim2real.identification.settings import DEFAULT, Settings


def replay(
    data: Recordings,
    effects: Sequence[Effect],
    *,
    rows: int | None = None,
    seed: int = 0,
    settings: Settings = DEFAULT,
) -> AlignedProvider:
    """Return the provider that replays logs.

    Args:
        data: the logs and their model.
        effects: whose values are looked for.
        rows: how many rows on from each measured state; None for the windows of a diagnosis.
        seed: nothing here is random.
        settings: see `Settings`.

    Raises:
        Sim2RealError: what `Data.of` and `Steps` refuse.
    """
    if rows is None:
        return Windows(data, effects)
    return Steps(data, effects, rows, settings)


class Windows(AlignedProvider):
    """Windows of the logs as a diagnosis cuts and simulates them; see `diagnosis.data.dataset`."""

    def __init__(self, data: Recordings, effects: Sequence[Effect]) -> None:
        own = data.windows
        self.effects = tuple(effects)
        self._simulator = Simulator(own, data.fixed)
        neutral = Plant(own.specs[0], self.effects, fixed=data.fixed).space.neutral
        real = np.where(own.mask[..., None], own.measured / own.scale, np.nan)
        pairs = [(window.log, window.episode) for window in own.windows]
        order = {pair: number for number, pair in enumerate(dict.fromkeys(pairs))}
        names = [joint.name for joint in own.joints]
        noise = own.floors() / own.scale
        super().__init__(
            real, np.array([order[p] for p in pairs]), own.scale, names, noise, neutral
        )

    def errors_of(self, pieces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return simulated minus measured over scale, (R, T, M)."""
        return self._simulator.run(self.effects, pieces, values).error
