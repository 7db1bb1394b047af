"""Whether whole episodes, replayed from their starts, follow an explanation.

    follows_episodes(data, fit, fixed, work)

Windows start anew from the measured state every few seconds, which hides what runs off slowly.
"""

from collections.abc import Sequence

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Work
from sim2real.diagnosis.data.windows import Window, cut_one
from sim2real.diagnosis.inference.fit import Fit
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.replayer import Job, Replayer
from sim2real.diagnosis.inference.unknowns import cap_directions


def follows_episodes(data: Data, fit: Fit, fixed: Sequence[Fixed], work: Work | None) -> bool:
    """Return whether whole episodes follow a fit rather than joints that stay.

    The model as given passes.
    """
    if not fit.hypothesis.members:
        return True
    replayer = Replayer(data.with_windows(cut_whole_episodes(data)), fixed, work)
    values = np.tile(fit.mean, (len(replayer.every), 1))
    (made,) = replayer.replay([Job(fit.hypothesis, values, replayer.every)])
    quick = replayer.coarsen(replayer.every)
    local = cap_directions(replayer, quick.starts(fit.hypothesis, values))
    none = np.zeros((*made.error.shape, 0))
    rows = replayer.times, replayer.used, replayer.noise
    likelihood = Likelihood(*rows, local, none, replayer.settings)
    follows, stays = (
        likelihood.train(likelihood.project(errors), replayer.every).density
        for errors in (made.error, replayer.holding())
    )
    return follows > stays


def cut_whole_episodes(data: Data) -> list[Window]:
    """Return every episode as one window, from where its first one starts."""
    found: dict[tuple[int, int], Window] = {}
    for window in data.windows:
        log = data.logs[window.log]
        rows = np.flatnonzero(log.episode == window.episode)
        place = window.log, window.episode
        if place not in found:
            ends = (window.start, window.start, int(rows[-1]) + 1)
            model, own = data.models[window.model], data.settings.windows
            args = (window.log, window.model, model, data.joints, ends, own)
            found[place] = cut_one(log, *args)
    return list(found.values())
