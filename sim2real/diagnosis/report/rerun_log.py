"""A log and its simulations as a recording for the Rerun viewer (the extra `viewer`).

    write_rerun("log.rrd", gaps, spec)           # then: rerun log.rrd

The measured robot stands among its ghosts, which are simulations of the same commands; below are
the joints' positions. Rerun is imported when it is needed and not before.
"""

from collections.abc import Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hardware.files import atomic_write
from sim2real.diagnosis.data.pairs import name_of
from sim2real.diagnosis.data.poses import positions
from sim2real.diagnosis.data.replay import Gap
from sim2real.diagnosis.report import robot_drawing
from sim2real.runs.errors import Sim2RealError

MEASURED = "measured"
COLOURS = {MEASURED: (170, 175, 185), "model as given": (196, 78, 0), "with effects": (0, 103, 163)}
TIMELINE = "time"


def write_rerun(path: str | Path, gaps: Mapping[str, Sequence[Gap]], spec: mujoco.MjSpec) -> Path:
    """Write a recording atomically; return its path.

    Args:
        path: an .rrd file.
        gaps: replays of the same logs by what was simulated: "model as given", "with effects".
        spec: the model of the logs.

    Raises:
        Sim2RealError: the package is missing.
    """
    if find_spec("rerun") is None:
        raise Sim2RealError("viewer=rerun needs rerun-sdk: pip install 'sim2real[viewer]'")
    rr = import_module("rerun")
    model = spec.copy().compile()
    with atomic_write(path) as temporary, rr.RecordingStream("sim2real") as stream:
        stream.save(temporary)
        for number, gap in enumerate(next(iter(gaps.values()))):
            lines = {MEASURED: gap.measured}
            lines |= {name: found[number].simulated for name, found in gaps.items()}
            _log(rr, stream, model, gap, lines)
        stream.flush()
    return Path(path)


def _log(rr: Any, stream: Any, model: mujoco.MjModel, gap: Gap, lines: Mapping[str, Any]) -> None:
    """Send every episode of a log: shapes once, and in each row where bodies and joints are."""
    places = list(positions(gap.log, model).values())
    shapes = list(robot_drawing.outlines(model))
    bodies = {body: model.body(body).name or body for _, body, *_ in shapes}
    for episode in np.unique(gap.log.episode):
        rows = gap.log.episode == episode
        place = f"{name_of(gap.log, 'log')}/episode {episode}"
        clock = [rr.TimeColumn(TIMELINE, duration=gap.log.time[rows])]
        for kind, line in lines.items():
            at, turned = _poses(model, places, line[rows])
            for body, called in bodies.items():
                poses = rr.Transform3D.columns(translation=at[:, body], quaternion=turned[:, body])
                where = f"{place}/robot/{kind}/{called}"
                rr.send_columns(where, clock, poses, recording=stream)
            for geom, body, points, radius in shapes:
                where = f"{place}/robot/{kind}/{bodies[body]}/shape {geom}"
                stream.log(where, _shape(rr, points, radius, COLOURS[kind]), static=True)
            for i, joint in enumerate(gap.joints):
                where = f"{place}/joints/{joint}/{kind}"
                values = rr.Scalars.columns(scalars=line[rows, i])
                stream.log(where, rr.SeriesLines(colors=COLOURS[kind], names=kind), static=True)
                rr.send_columns(where, clock, values, recording=stream)


def _poses(
    model: mujoco.MjModel, places: list[int], line: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return where bodies are, (T, B, 3), and how they are turned, (T, B, 4), w last."""
    data = robot_drawing.at_home(model)
    at, turned = [], []
    for values in line:
        data.qpos[places] = values
        mujoco.mj_kinematics(model, data)
        at.append(data.xpos.copy())
        turned.append(np.roll(data.xquat, -1, axis=1))
    return np.array(at), np.array(turned)


def _shape(rr: Any, points: np.ndarray, radius: float, colour: tuple[int, int, int]) -> Any:
    """Return a sphere, a capsule, or the box around corners."""
    if radius and len(points) == 1:
        return rr.Points3D(points, radii=radius, colors=colour)
    if radius:
        return rr.LineStrips3D([points], radii=radius, colors=colour)
    low, high = points.min(axis=0), points.max(axis=0)
    return rr.Boxes3D(mins=[low], sizes=[high - low], colors=colour)
