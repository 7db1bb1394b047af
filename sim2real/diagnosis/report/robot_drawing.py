"""The robot as a drawing whose joints carry their shares of the gap.

    picture = robot(model, {"elbow": 0.84, "shoulder": 0.16})

Shapes are drawn from the model's geoms, flat, in a parallel projection from slightly above; no
graphics library is needed. Where a model has meshes, their boxes stand for them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from markupsafe import Markup
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from sim2real.diagnosis.data.pairs import TURN
from sim2real.diagnosis.data.poses import home
from sim2real.diagnosis.report import text

WIDTH, HEIGHT, MARGIN, LABEL = 620.0, 330.0, 26.0, 150.0  # units; labels stand left and right
AZIMUTH, ELEVATION = np.radians(20.0), np.radians(12.0)  # of the view, from straight ahead
LEAST = 0.005  # share below which a joint has no label
NAMED = 8  # joints that are named at most
RIM = 24  # points on the outline of a cylinder's end
DISC, DISC_GROWTH = 5, 9  # radius of a joint with no share, and what the whole gap adds, units
THINNEST, EDGE = 1.5, 1.6  # width of a limb, and what its edge adds, units
END, LEAD = 8.0, 110.0  # a label's distance from the side, and length before its line, units
ROW = 26  # between labels, units: room for the larger ones of a phone
SMALLEST = 1e-6  # m: a robot is drawn as if it were at least so large
PALE, DARK, BEND = 0.15, 0.85, 0.7  # tint of no share, what the whole gap adds, and the exponent
TINT_DIGITS = 3
SPHERE, CAPSULE = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
MIDDLE = np.zeros((1, 3))  # of a sphere
PLANES = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))


class _Shape(NamedTuple):
    """A geom as seen: its points (n, 2), its radius where it is round, and how far away it is."""

    points: np.ndarray
    radius: float
    depth: float


def robot(model: mujoco.MjModel | None, shares: Mapping[str, float]) -> Markup:
    """Draw the robot in its keyframe `home`, else by default; its joints in `shares` are marked."""
    if model is None:
        return Markup("")
    data, own = at_home(model), {model.joint(i).name for i in range(model.njnt)}
    shares = {name: share for name, share in shares.items() if name in own}
    shapes = sorted(_shapes(model, data), key=lambda shape: -shape.depth)
    joints = {name: _seen(data.xanchor[model.joint(name).id])[0] for name in shares}
    if not shapes or not joints:
        return Markup("")
    scale, shift = _fit(shapes, list(joints.values()))
    placed = (_Shape(s.points * scale + shift, s.radius * scale, s.depth) for s in shapes)
    marks = {name: point * scale + shift for name, point in joints.items()}
    parts = [*map(_draw, placed), *_marks(marks, shares)]
    listed = ", ".join(f"{name} {text.percent(share)}" for name, share in shares.items())
    head = Markup(
        '<svg class="plot robot" viewBox="0 0 {:.0f} {:.0f}" role="img"'
        ' aria-label="The robot; shares of the gap by joint: {}">'
    )
    return head.format(WIDTH, HEIGHT, listed) + Markup("").join(parts) + Markup("</svg>")


def at_home(model: mujoco.MjModel) -> mujoco.MjData:
    """Return a model in its keyframe `home`, else as it is by default."""
    data = mujoco.MjData(model)
    data.qpos[:] = home(model)[0]
    mujoco.mj_forward(model, data)
    return data


def outlines(model: mujoco.MjModel) -> Iterator[tuple[int, int, np.ndarray, float]]:
    """Yield the geoms that a person would see, but the ground, and their bodies.

    Each with its points in its body's frame (n, 3): the middle of a sphere, the ends of a capsule,
    else corners; and its radius [m], 0 where points are corners.
    """
    for i in range(model.ngeom):
        kind, size = int(model.geom_type[i]), model.geom_size[i]
        if kind in PLANES or model.geom_rgba[i, 3] == 0:
            continue
        turn = Rotation.from_quat(model.geom_quat[i], scalar_first=True)
        if kind == SPHERE:
            points, radius = MIDDLE, float(size[0])
        elif kind == CAPSULE:
            points, radius = np.outer([-size[1], size[1]], (0, 0, 1)), float(size[0])
        else:
            points, radius = _corners(model, i), 0.0
        yield i, int(model.geom_bodyid[i]), model.geom_pos[i] + turn.apply(points), radius


def _seen(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Project points (..., 3) to the picture (..., 2), y down, and say how far they are, (...)."""
    right = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    ahead = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0]) * np.cos(ELEVATION)
    ahead[2] = -np.sin(ELEVATION)
    up = np.cross(right, ahead)
    return np.stack([points @ right, -(points @ up)], axis=-1), points @ ahead


def _shapes(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[_Shape]:
    """Yield the geoms that a person would see, but the ground."""
    for i, body, points, radius in outlines(model):
        seen = _seen(data.xpos[body] + points @ data.xmat[body].reshape(3, 3).T)[0]
        depth = float(_seen(data.geom_xpos[i])[1])
        yield _Shape(seen if radius else _hull(seen), radius, depth)


def _corners(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return points on the outline of a geom in its own frame, (n, 3)."""
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    if int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_CYLINDER):
        turn = np.linspace(0, TURN, RIM, endpoint=False)
        radius, long, _ = model.geom_size[geom]
        rim = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return np.concatenate([np.column_stack([rim, np.full(RIM, z)]) for z in (-long, long)])
    return middle + half * np.array(list(itertools.product((-1, 1), repeat=3)))


def _hull(points: np.ndarray) -> np.ndarray:
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:  # seen edge-on
        return points


def _fit(shapes: Sequence[_Shape], joints: Sequence[np.ndarray]) -> tuple[float, np.ndarray]:
    """Return the size of a metre in the picture, and the shift of points of that size, (2,)."""
    low = np.min([*(s.points.min(axis=0) - s.radius for s in shapes), *joints], axis=0)
    high = np.max([*(s.points.max(axis=0) + s.radius for s in shapes), *joints], axis=0)
    size, middle = np.array([WIDTH, HEIGHT]), np.mean([low, high], axis=0)
    room = size - 2 * np.array([LABEL, MARGIN])
    scale = float((room / np.maximum(high - low, SMALLEST)).min())
    return scale, size / 2 - middle * scale


def _draw(shape: _Shape) -> Markup:
    points = "L".join(f"{x:.1f} {y:.1f}" for x, y in shape.points)
    if shape.radius == 0:
        return Markup('<path class="part" d="M{}Z"/>').format(points)
    points += "Z" if len(shape.points) == 1 else ""
    width = max(2 * shape.radius, THINNEST)
    line = Markup('<path class="{}" stroke-width="{:.1f}" d="M{}"/>')
    return line.format("edge", width + EDGE, points) + line.format("limb", width, points)


def _marks(marks: Mapping[str, np.ndarray], shares: Mapping[str, float]) -> Iterator[Markup]:
    """Yield a disc at each joint, and names at both sides for those with the largest shares."""
    disc = Markup('<circle class="joint" cx="{:.1f}" cy="{:.1f}" r="{:.1f}" style="--tint: {}"/>')
    lead = Markup('<path class="lead" d="M{:.1f} {:.1f}L{:.1f} {:.1f}"/>')
    label = Markup(
        '<text class="name" text-anchor="{}" x="{:.1f}" y="{:.1f}">{}'
        ' <tspan class="share">{}</tspan></text>'
    )
    for name in sorted(marks, key=lambda n: shares[n]):
        share = max(shares[name], 0.0)
        tint = round(PALE + DARK * min(share, 1.0) ** BEND, TINT_DIGITS)
        yield disc.format(*marks[name], DISC + DISC_GROWTH * np.sqrt(share), tint)
    named = sorted((n for n in marks if shares[n] >= LEAST), key=lambda n: -shares[n])[:NAMED]
    order = sorted(named, key=lambda n: float(marks[n][0]))  # from left to right
    half = len(order) // 2
    for side, end, near, own in (
        ("start", END, END + LEAD, order[:half]),
        ("end", WIDTH - END, WIDTH - END - LEAD, order[half:]),
    ):
        own = sorted(own, key=lambda n: float(marks[n][1]))  # from top to bottom
        for name, row in zip(own, _rows([float(marks[n][1]) for n in own]), strict=True):
            yield lead.format(near, row, *marks[name])
            yield label.format(side, end, row, name, text.percent(shares[name]))


def _rows(wanted: list[float]) -> list[float]:
    """Return heights near those wanted that keep labels apart."""
    rows: list[float] = []
    for y in wanted:
        rows.append(max(y, rows[-1] + ROW if rows else MARGIN))
    over = max([0.0, *(row - (HEIGHT - MARGIN) for row in rows)])
    return [row - over for row in rows]
