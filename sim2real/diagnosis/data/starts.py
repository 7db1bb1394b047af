"""What a log does not tell of a window's start, where no servo corrects it.

    data = with_free_starts(data, fixed)        # data.nuisance is set

A joint that a motor drives by torque keeps an error of its start: half a count in the position, and
the error of a slope through a few readings in the speed, which grows as long as the window lasts.
Each window is simulated from starts that are off by one standard deviation of each, and what that
changes is taken out of all errors (`nuisance`). Position servos pull such errors back: windows
of theirs stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.noise_floor import reading_noise
from sim2real.diagnosis.data.nuisance import marginal
from sim2real.diagnosis.data.recording import NEAR
from sim2real.diagnosis.data.simulate import errors_as_given
from sim2real.diagnosis.data.windows import Window, unsure


def with_free_starts(data: Data, fixed: Sequence[Fixed] = ()) -> Data:
    """Return the data with what their starts leave open taken out of errors.

    Args:
        data: the windows; where their starts are known well enough they stay as they are.
        fixed: effects that are known.
    """
    if not unsure(data.logs, data.models, data.joints):
        return data
    columns = [f"qpos.{joint.name}" for joint in data.joints]
    noise = np.array([reading_noise(data.logs, column, data.settings) for column in columns])
    noise = np.maximum(noise, data.settings.encoder.same)  # a joint that never moves has none
    ways = [_way(data, index, fixed, noise) for index in range(2 * len(data.joints))]
    return replace(data, nuisance=marginal(np.stack(ways, axis=-1), noise / data.scale))


def _way(data: Data, index: int, fixed: Sequence[Fixed], noise: np.ndarray) -> np.ndarray:
    """Return what one standard deviation of an unknown changes, (W, T, M).

    Args:
        data: the windows.
        index: of a joint's position, or, from M on, of its speed.
        fixed: effects that are known.
        noise: of a reading of each joint [rad or m], (M,).
    """
    of_speed, joint = divmod(index, len(data.joints))
    move = faster if of_speed else further
    ahead, behind = (
        errors_as_given(
            data, [move(data, w, joint, sign * noise[joint]) for w in data.windows], fixed
        )
        for sign in (1, -1)
    )
    return (ahead - behind) / 2


def further(data: Data, window: Window, joint: int, by: float) -> Window:
    """Return a window that starts with one joint at another position."""
    qpos = window.recording.qpos.copy()
    qpos[data.joints[joint].qpos] += by
    return window._replace(recording=window.recording._replace(qpos=qpos))


def faster(data: Data, window: Window, joint: int, by: float) -> Window:
    """Return a window that starts with one joint at the speed of readings that are off by so much.

    The speed is the slope of a line through neighbours.
    """
    model, own = data.models[window.model], window.recording
    step = float(np.median(np.diff(own.time[: 2 * NEAR + 1])))
    times = step * np.arange(-min(NEAR, window.start), NEAR + 1)
    dof = model.jnt_dofadr[model.jnt_qposadr == data.joints[joint].qpos]
    qvel = own.qvel.copy()
    qvel[dof] += by / float(np.sqrt(((times - times.mean()) ** 2).sum()))
    return window._replace(recording=own._replace(qvel=qvel))
