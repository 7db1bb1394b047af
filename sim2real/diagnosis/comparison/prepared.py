"""Logs, replayed with what they share: what every comparison of some of them starts from.

made = prepare(logs, "arm.xml", [], ("coulomb_friction", "backlash"), settings)
made.response.change, made.error                    # (P, n, T, M), (W, T, M)
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.comparison.alike import friction, in_proportion
from sim2real.diagnosis.comparison.motions import Motions, aligned, pair
from sim2real.diagnosis.comparison.response import Response, Watch, errors, respond, watched
from sim2real.diagnosis.comparison.shared import share
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import Settings


class Prepared(NamedTuple):
    """Logs, replayed: what every comparison of some of them starts from."""

    data: Data
    simulator: Simulator
    partner: np.ndarray  # (W,) the window of the first log with the same motion
    windows: np.ndarray  # (n,) those of first logs, which the response is of
    motions: Motions
    watch: Watch
    response: Response
    error: np.ndarray  # (W, T, M) of all windows
    friction: dict[int, float]  # of each joint, by the column of its change


def prepare(
    logs: Sequence[Log],
    model: str | Path | None,
    known: Sequence[Fixed],
    names: Sequence[str],
    settings: Settings,
) -> Prepared:
    """Replay logs with what they share, and with each watched effect a little larger."""
    motions = pair(logs, settings)
    data, partner = aligned(Data.of(logs, model, settings), motions)
    windows = np.flatnonzero(partner == np.arange(len(partner)))
    watch = watched(data, known, names)
    simulator = Simulator(data, watch.fixed)
    if not known:
        watch = share(simulator, watch, windows)
    response = respond(simulator, watch, windows)
    rubs = friction(data, watch, response)
    response = in_proportion(response, rubs)
    error = errors(simulator, watch, np.arange(len(data.windows)))
    return Prepared(data, simulator, partner, windows, motions, watch, response, error, rubs)
