"""What the rows with torque say alone: a cause whose law is wrong for a joint that swings freely.

    found = refit_torque_on(search, search.run())

A cause may have the right name and a law that fails without torque: friction that follows the
motor's load is gone when the motor is off, where another law of the same name still rubs. Judged on
all rows it loses to any two effects that leave swings alone. So where a search explained too
little, the rows with torque are searched by themselves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.windows import Window
from sim2real.diagnosis.settings import TINY_SQUARE


def refit_torque_on(search: Search, found: Found) -> Found:
    """Return the one cause that explains the rows with torque and fails without, or what was found.

    Args:
        search: of all rows, after its run.
        found: what it found.
    """
    data = search.problem.data
    limits, after = data.settings.torque_on, search.blocks.rms(found.error)
    done = after <= limits.explained_floors * search.floor
    if done or search.closed(after) >= limits.explained:
        return found
    on = with_torque(data)  # (W, T)
    off = data.mask & ~on
    chosen = np.flatnonzero(on.sum(axis=1) > 1)
    if not off.any() or len(chosen) < limits.windows_min:
        return found
    own = _search(search, on, chosen)
    contenders = own.race(own.none, own.base)
    if not contenders or own.closed(own.blocks.rms(contenders[0].error)) < limits.closed:
        return found
    best = own.polish(contenders[0])
    least = own.blocks.rms(np.where(on[..., None], found.error, 0.0)[chosen])
    room = limits.simpler if len(found.fit.members) > 1 else 1.0
    known = {(m.name, m.place) for m in found.fit.members}
    whole = search.problem.held_out(best.fit.members, best.fit.values)
    harm = (whole[off] ** 2).sum() / max((search.base[off] ** 2).sum(), TINY_SQUARE)
    same = len(known) == 1 and (best.candidate.name, best.candidate.place) in known
    if same or harm < limits.harm or own.blocks.rms(best.error) > room * least:
        return found
    rivals = [Contender(c.candidate, c.fit, _placed(c.error, data, chosen)) for c in contenders]
    label = best.candidate.label
    seen = on[..., None]
    return replace(
        found, fit=best.fit, error=whole, steps=[(label, whole)], rivals={label: rivals}, seen=seen
    )


def with_torque(data: Data) -> np.ndarray:
    """Return the compared rows at which every servo is on, (W, T)."""
    found = data.mask.copy()
    for row, window in zip(found, data.windows, strict=True):
        row[: len(window.usable)] &= _on(window)
    return found


def _on(window: Window) -> np.ndarray:
    """Return the rows of a window at which every servo is on, (T,)."""
    powered = window.recording.powered
    if powered is None:
        return np.ones(len(window.usable), bool)
    latest = np.searchsorted(window.recording.time, window.sample[:, 0], side="right") - 1
    return np.asarray(powered[np.maximum(latest, 0)].all(axis=1))


def _search(search: Search, on: np.ndarray, chosen: np.ndarray) -> Search:
    """Return a search that compares only these rows, (W, T), of the chosen windows."""
    data = search.problem.data
    windows = tuple(
        w._replace(usable=row[: len(w.usable)]) for w, row in zip(data.windows, on, strict=True)
    )
    part = replace(data, windows=windows, mask=on).only(chosen)
    simulator = search.problem.simulator.of(part)
    rng = search.rng.spawn(1)[0]
    problem = Problem(part, simulator)
    return Search(
        problem,
        search.options,
        search.floor,
        rng,
        search.on_progress,
        search.floors,
        search.witnessed,
    )


def _placed(error: np.ndarray, data: Data, chosen: np.ndarray) -> np.ndarray:
    """Return errors of the chosen windows among zeros for the others, (W, T, M)."""
    whole = np.zeros((len(data.windows), *error.shape[1:]))
    whole[chosen] = error
    return whole
