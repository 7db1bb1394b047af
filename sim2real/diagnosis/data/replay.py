"""How far logs are from their simulation, with nothing fitted: what `run=replay` writes.

    gaps = measure_all(logs, specs)
    write(gaps, Path("outputs/replay"))

Positions are compared at the moments when they were read (`stamp.<joint>`, where the log has it).
The time that the robot's bus takes (`command_delay` in the log's metadata) is part of the model.
"""

import json
import logging
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.plant import Fixed
from envs.replay import DivergedError
from hardware.log import Log
from sim2real.diagnosis.data.impedance import impedance_of
from sim2real.diagnosis.data.pairs import name_of
from sim2real.diagnosis.data.poses import positions
from sim2real.diagnosis.data.recording import as_recorded, check_log, to_recording
from sim2real.diagnosis.data.refuse import refuse_clock
from sim2real.diagnosis.data.trial import trial
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
MILLI = 1e-3
SHOWN = 4  # logs in the picture
WIDTH, HEIGHT = 4.2, 1.9  # of a panel [in]


class Gap(NamedTuple):
    """A log, what was measured and what the simulation made of its commands."""

    log: Log
    joints: tuple[str, ...]  # those compared, M
    measured: np.ndarray  # (T, M) rad or m; NaN in rows that are not compared (flag.fresh = 0)
    simulated: np.ndarray  # (T, M)

    def errors(self) -> dict[str, dict[str, float]]:
        """Return root mean square and mean absolute error of each joint."""
        off = self.simulated - self.measured
        return {joint: _error(off[:, i]) for i, joint in enumerate(self.joints)}


def measure(log: Log, spec: mujoco.MjSpec, fixed: Sequence[Fixed] = ()) -> Gap:
    """Replay a log's episodes in a model with fixed effects."""
    return measure_all([log], [spec], fixed)[0]


def measure_all(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], fixed: Sequence[Fixed] = ()
) -> list[Gap]:
    """Do the same for many logs, those of one model side by side.

    `specs` are their models, the same object where logs share one, and a bus delay.

    Raises:
        LogError: a log that names what its model lacks.
        Sim2RealError: a model that diverges, a log whose time is not in seconds.
    """
    found: dict[int, Gap] = {}
    kinds = [(id(spec), impedance_of(log)) for log, spec in zip(logs, specs, strict=True)]
    for kind in dict.fromkeys(kinds):
        own = [number for number, other in enumerate(kinds) if other == kind]
        gaps = _of_one_model([logs[number] for number in own], specs[own[0]], fixed)
        found |= dict(zip(own, gaps, strict=True))
    return [found[number] for number in range(len(logs))]


def _of_one_model(
    logs: Sequence[Log], spec: mujoco.MjSpec, fixed: Sequence[Fixed]
) -> Iterator[Gap]:
    """Yield the gaps of logs that share a model, their episodes side by side."""
    delayed = as_recorded(spec, logs[0])
    model = delayed.copy().compile()
    for log in logs:
        check_log(log, model)
        refuse_clock(log)
    episodes = [part for log in logs for part in log.episodes()]
    recordings = [to_recording(part, model) for part in episodes]
    paths = trial(delayed, recordings, fixed)
    for row, (part, recording, path) in enumerate(zip(episodes, recordings, paths, strict=True)):
        known = np.isfinite(path).all(axis=1)
        if not known.all():
            error = DivergedError(row, float(recording.time[known.argmin()]))
            raise Sim2RealError(f"{part.path}, episode {part.episode[0]}: {error}")
    each = np.split(np.concatenate(paths), np.cumsum([len(log) for log in logs])[:-1])
    for log, path in zip(logs, each, strict=True):
        places = positions(log, model)
        measured = np.column_stack([log.column(f"qpos.{name}") for name in places])
        measured[~log.fresh] = np.nan
        yield Gap(log, tuple(places), measured, path[:, list(places.values())])


def _error(difference: np.ndarray) -> dict[str, float]:
    return {
        "rmse": float(np.sqrt(np.nanmean(difference**2))),
        "mae": float(np.nanmean(np.abs(difference))),
    }


def summary(gaps: Sequence[Gap]) -> dict[str, Any]:
    """Return the content of replay.json: errors in rad or m, over all rows and compared joints."""
    every = np.concatenate([(gap.simulated - gap.measured).ravel() for gap in gaps])
    logs = [{"log": str(gap.log.path), "joints": gap.errors()} for gap in gaps]
    return {"logs": logs, **_error(every)}


def write(gaps: Sequence[Gap], out: Path) -> None:
    """Write replay.json, the table and the picture into the folder."""
    found = summary(gaps)
    table = Table(("log", "joint", "rmse", "mae"))
    for gap in gaps:
        for joint, error in gap.errors().items():
            table.add(name_of(gap.log, ""), joint, error["rmse"] / MILLI, error["mae"] / MILLI)
    table.add("all", "", found["rmse"] / MILLI, found["mae"] / MILLI)
    note = "Errors in mrad (hinges) or mm (slides), over all rows; nothing was fitted."
    table.notes.append(note)
    draw(gaps[:SHOWN], out / "plots" / "replay.png")
    table.write(out / "table")
    write_text(out / "replay.json", json.dumps(found, indent=1))
    parts: dict[str, list[np.ndarray]] = {}
    for gap in gaps:
        for joint, off in zip(gap.joints, (gap.simulated - gap.measured).T, strict=True):
            parts.setdefault(joint, []).append(off)
    sizes = {joint: _error(np.concatenate(own))["rmse"] for joint, own in parts.items()}
    each = ", ".join(f"{j} {sizes[j]:.3g}" for j in sorted(sizes, key=lambda j: -sizes[j]))
    log_.info("rmse %.4g rad or m over %d logs: %s", found["rmse"], len(gaps), each)


def draw(gaps: Sequence[Gap], path: Path) -> None:
    """Draw measured and simulated positions of each log's first episode, a row a joint."""
    rows = max(len(gap.joints) for gap in gaps)
    with figure(path, rows, len(gaps), (WIDTH * len(gaps), 1.0 + HEIGHT * rows)) as (_, axes):
        for column, gap in enumerate(gaps):
            first = gap.log.episode == gap.log.episode[0]
            for panel in axes[len(gap.joints) :, column]:
                panel.set_visible(False)
            for row, joint in enumerate(gap.joints):
                panel, time = axes[row, column], gap.log.time[first]
                panel.plot(time, gap.measured[first, row], color=INK, label="measured")
                panel.plot(time, gap.simulated[first, row], color=COLOURS[1], label="simulated")
                panel.set_ylabel(f"{joint} (rad or m)")
            axes[0, column].set_title(gap.log.path.stem if gap.log.path else "")
            axes[len(gap.joints) - 1, column].set_xlabel("time (s)")
        axes[0, 0].legend(loc="upper right")
