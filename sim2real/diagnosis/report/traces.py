"""Recordings as a reader of a report sees them: each joint measured and simulated, and the signals.

    found = traces(data, errors, floors)         # one Trace for each joint of each episode
    found[0].nominal, found[0].corrected         # (T,), NaN where nothing was compared
    signals(data.logs, data.models)              # commands, currents, voltages

The simulated lines are those that the gap's numbers are made of: every window is replayed from the
measured state at its start, under values that were fitted to other windows. So what is seen is held
out throughout, and a model that runs off comes back where the next window begins.
"""

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from envs.effects.servo import is_servo
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.pairs import driven_by, name_of, unit_of
from sim2real.diagnosis.data.recording import episode_rows
from sim2real.diagnosis.evidence import Kind, Signal, Trace

Errors = Mapping[frozenset[int], np.ndarray]
SWITCHED = 4  # causes at most that a reader can switch: of more there are too many combinations
KINDS: dict[str, Kind] = {"ctrl": "command", "current": "current", "voltage": "voltage"}
UNITS = {"current": "A", "voltage": "V"}


def traces(data: Data, errors: Errors, floors: np.ndarray) -> tuple[Trace, ...]:
    """Return every joint of every episode.

    Args:
        data: the windows.
        errors: held-out errors (W, T, M) with these causes in the model; those of none and of all
            are there.
        floors: noise floor of each joint [rad or m], (M,).
    """
    episodes = (
        (number, rows) for number, log in enumerate(data.logs) for rows in episode_rows(log)
    )
    return tuple(trace for one in episodes for trace in _traces(data, errors, floors, *one))


def _traces(
    data: Data, errors: Errors, floors: np.ndarray, number: int, rows: slice
) -> Iterator[Trace]:
    """Yield the joints of one episode: rows of a log."""
    log, whole = data.logs[number], max(errors, key=len)
    inside = [
        (i, window, slice(window.first - rows.start, window.last - rows.start))
        for i, window in enumerate(data.windows)
        if window.log == number and rows.start <= window.first < rows.stop
    ]
    starts = np.array([own.start for *_, own in inside], int)
    for j, joint in enumerate(data.joints):
        measured = log.column(f"qpos.{joint.name}")[rows].copy()
        lines = {causes: np.full(len(measured), np.nan) for causes in errors}
        for i, window, own in inside:
            measured[own] = window.measured[:, j]  # an angle counts its turns from where it starts
            for causes, line in lines.items():
                error = joint.scale * errors[causes][i, : len(window.usable), j]
                line[own] = window.measured[:, j] + np.where(window.usable, error, np.nan)
        clock = log.columns.get(f"stamp.{joint.name}", log.time)[rows]
        name = name_of(log, f"log {number + 1}")
        about = (name, int(log.episode[rows.start]), joint.name, joint.unit)
        ends = (lines[frozenset()], lines[whole])
        subsets = lines if 0 < len(whole) <= SWITCHED and len(lines) == 2 ** len(whole) else {}
        yield Trace(*about, clock, measured, *ends, float(floors[j]), starts, subsets)


def signals(logs: Sequence[Log], models: Sequence[mujoco.MjModel]) -> tuple[Signal, ...]:
    """Return the commands of every episode, and its currents and voltages where they are logged."""
    found = []
    for number, (log, model) in enumerate(zip(logs, models, strict=True), 1):
        for rows in episode_rows(log):
            about = (name_of(log, f"log {number}"), int(log.episode[rows.start]))
            for column, values in log.columns.items():
                kind, _, actuator = column.partition(".")
                if kind in KINDS:
                    own = (UNITS[kind], None) if kind in UNITS else _driven(log, model, actuator)
                    line = log.time[rows], values[rows]
                    found.append(Signal(*about, KINDS[kind], actuator, *own, *line))
    return tuple(found)


def _driven(log: Log, model: mujoco.MjModel, actuator: str) -> tuple[str, str | None]:
    """Return the joint whose position an actuator's command is, after its unit; None for none."""
    own = driven_by(model, actuator)
    if own is None or not is_servo(model, own[0]):
        return "", None
    return unit_of([(log, model)], own[1]), own[1]
