"""Short windows that start from an estimate of the whole state, and what is not known of it.

    data = grounded(data, estimates, fixed)

Each window is simulated from its start and from starts that are off by one standard deviation of
each unknown. Where the model explains the rest, a damped Gauss-Newton step moves the start to where
it follows encoders and IMU best (a smoother over MuJoCo's own dynamics, as long as a window): a
wrong model would move it to a wrong place. What the unknowns change is left to the likelihood
(`Data.starts`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import errors_as_given
from sim2real.diagnosis.data.windows import Joint, Window, cut_one
from sim2real.diagnosis.ground.base import rotations
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.ground.pushes import is_pushed, rows_of
from sim2real.diagnosis.ground.starts import clear_starts, moved, unknowns
from sim2real.diagnosis.ground.turns import back
from sim2real.diagnosis.settings import Ground

HALF = 0.5  # a quaternion's vector part over the angle that it turns by
PARTS = (4, 5, 6)  # of a free joint's position: that vector part


def grounded(data: Data, estimates: Sequence[Estimate], fixed: Sequence[Fixed] = ()) -> Data:
    """Return the data, of logs with columns of the estimates, with windows that start from these.

    `fixed` are effects that are in the model already.
    """
    settings = data.settings.ground
    plain = replace(data, joints=tuple(_joints(data, estimates, settings)))
    windows, doubts = [], []
    for number, estimate in enumerate(estimates):
        model = data.models[data.which[number]]
        for rows in rows_of(estimate, settings):
            windows.append(_window(plain, number, estimate, rows))
            doubts.append(unknowns(estimate, model, rows[0], settings))
    cut = plain.with_windows(windows)
    error, ways = _responses(cut, doubts, fixed)
    left = clear_starts(error, ways, settings.error_rad)
    if np.sqrt(cut.mean_squares(left).mean()) < 2 * settings.error_rad:  # it may be trusted
        cut = _refined(cut, doubts, error, ways, fixed)
    return replace(cut, starts=ways).only(np.flatnonzero(~is_pushed(cut, left)))


def _joints(data: Data, estimates: Sequence[Estimate], settings: Ground) -> list[Joint]:
    """Return the joints that were measured, and the base's turn as three more."""
    model, base = data.models[0], estimates[0].base
    loose = {model.joint(j).name for j in base.joints}
    found = [joint for joint in data.joints if joint.name not in loose]
    if len({joint.unit for joint in found}) == 1:
        found = [joint._replace(scale=1.0) for joint in found]
    if base.is_free and all(estimate.felt for estimate in estimates):  # else no IMU says it
        name, first = model.joint(base.joints[0]).name, int(base.turn[0])
        floor = HALF * settings.error_rad
        for k in PARTS:
            column = np.concatenate([e.log.column(f"qpos.{name}.{k}") for e in estimates])
            place, spread = first + k - 3, float(column.std())
            found.append(Joint(f"{name}.{k}", place, "rad", 0.0, spread, HALF, floor))
    return found


def _window(data: Data, number: int, estimate: Estimate, rows: tuple[int, int, int]) -> Window:
    """Return a window with the estimated state at its start, its heading 0."""
    base, (start, first, last), which = estimate.base, rows, data.which[number]
    measured = [joint for joint in data.joints if f"qpos.{joint.name}" in data.logs[number].columns]
    window = cut_one(data.logs[number], number, which, data.models[which], measured, rows)
    qpos, qvel = estimate.qpos[start].copy(), estimate.qvel[start].copy()
    said = window.measured.copy()
    if base.is_free:
        level = back(estimate.qpos[start, base.turn])
        turn = (level * rotations(estimate.qpos[start:last, base.turn])).as_quat(scalar_first=True)
        turn *= np.where(turn @ turn[0] < 0, -1.0, 1.0)[:, None]
        qvel[base.dofs] = level.apply(qvel[base.dofs])
        qpos[base.turn] = turn[0]
        if data.joints[-1].scale == HALF:  # its turn is compared
            said[:, -len(PARTS) :] = turn[first - start :, 1:]
    return window._replace(recording=window.recording._replace(qpos=qpos, qvel=qvel), measured=said)


def _started(
    data: Data, windows: Sequence[Window], doubts: Sequence[np.ndarray], amounts: np.ndarray
) -> list[Window]:
    """Return windows (n,) whose starts are off by amounts (n, D) of the unknowns."""
    models = [data.models[window.model] for window in windows]
    starts = zip(models, windows, doubts, amounts, strict=True)
    return [w._replace(recording=moved(m, w.recording, doubt, own)) for m, w, doubt, own in starts]


def _responses(
    data: Data, doubts: Sequence[np.ndarray], fixed: Sequence[Fixed]
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (W, T, M), and their change by one deviation of each unknown (W, T, M, D)."""
    count, size = len(doubts), doubts[0].shape[1]
    amounts = np.vstack([np.zeros(size), np.eye(size)])
    each = [k for k in range(count) for _ in amounts]
    some = [data.windows[k] for k in each]
    starts = _started(data, some, [doubts[k] for k in each], np.tile(amounts, (count, 1)))
    error = errors_as_given(data, starts, fixed)
    error = error.reshape(count, len(amounts), *error.shape[1:])
    return error[:, 0], np.moveaxis(error[:, 1:] - error[:, :1], 1, -1)


def _refined(
    data: Data,
    doubts: Sequence[np.ndarray],
    error: np.ndarray,
    ways: np.ndarray,
    fixed: Sequence[Fixed],
) -> Data:
    """Return the data with starts from which the model follows better, where there are any."""
    noise = data.settings.ground.error_rad
    flat = (ways / noise).reshape(len(ways), -1, ways.shape[3])
    rest = (error / noise).reshape(len(error), -1)
    curve = np.einsum("wnd,wne->wde", flat, flat) + np.eye(flat.shape[2])
    step = -np.linalg.solve(curve, np.einsum("wnd,wn->wd", flat, rest)[..., None])[..., 0]
    best, cost = list(data.windows), (rest**2).sum(axis=1)
    for share in (1.0, HALF):
        amounts = share * step
        tried = _started(data, data.windows, doubts, amounts)
        left = (errors_as_given(data, tried, fixed) / noise).reshape(len(error), -1)
        price = (left**2).sum(axis=1) + (amounts**2).sum(axis=1)
        for i in np.flatnonzero(price < cost):
            best[i], cost[i] = tried[i], price[i]
    return data.with_windows(best)
