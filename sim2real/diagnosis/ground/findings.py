"""What an estimate of the base says about the log: how sure it is, who slips, and the IMU itself.

findings = check_ground(estimates, models, settings)

An IMU is held against itself (gyro against the slope of the orientation) and against the ground
(soles that stand are in its plane).
"""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np
from scipy.ndimage import convolve1d
from scipy.optimize import brute

from sim2real.diagnosis.ground.base import imu_of, posed, rotations
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.ground.turns import back, slopes
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import TINY, Ground

MILLI = 1e-3
MANY = 3  # soles that determine a plane
SIMPSON = (1 / 6, 2 / 3, 1 / 6)  # weights of three rows, whose mean a slope over them is
EDGE = 2  # rows at either end of an episode that have no slope of a slope


def check_ground(
    estimates: Sequence[Estimate], models: Sequence[mujoco.MjModel], settings: Ground
) -> list[Finding]:
    """Return what there is to say about logs whose base was estimated; nothing without any."""
    if not estimates:
        return []
    pairs = list(zip(estimates, models, strict=True))
    found = [_estimated(estimates, models[0])]
    found += _slips(estimates, models[0], settings)
    if estimates[0].base.is_free and all(estimate.felt for estimate in estimates):
        found += _gyros(pairs, settings)
        found += _tilts(pairs, settings)
    return found


def _estimated(estimates: Sequence[Estimate], model: mujoco.MjModel) -> Finding:
    base = estimates[0].base
    name = model.joint(base.joints[0]).name if base.is_free else "the boom"
    unsure = np.concatenate([e.walk.unsure for e in estimates])
    return Finding(
        "base",
        name,
        f"The position of {name} is not logged. Short windows start from an estimate of it: "
        "orientation from the IMU where there is one, height and speed from feet that stand on "
        f"the ground (its speed is unsure by {np.sqrt(np.mean(unsure**2)):.2g} m/s). What such a "
        "start may cause is taken out of every error.",
        "No action needed; a tracker's position (`sensor.position_0` to `_2`) makes starts surer.",
    )


def _slips(
    estimates: Sequence[Estimate], model: mujoco.MjModel, settings: Ground
) -> Iterator[Finding]:
    """Soles that touch the ground and move across it."""
    soles = estimates[0].base.soles
    touch = np.concatenate([e.walk.touch for e in estimates])
    slip = np.concatenate([e.walk.slip for e in estimates]) > settings.slip_m_s
    often = {}
    for i, sole in enumerate(soles.tolist()):
        name = model.geom(sole).name or model.body(int(model.geom_bodyid[sole])).name
        share = touch[:, i] @ slip[:, i] / max(touch[:, i].sum(), TINY)
        if min(touch[:, i].mean(), share) > settings.told_share:
            often[name] = share
    if often:
        slipping = ", ".join(f"{name} {share:.0%}" for name, share in often.items())
        yield Finding(
            "slip",
            None,
            f"Soles slip during part of the time that they touch the ground: {slipping}. "
            "Speeds of the base are taken from the soles that do not, and are less sure then.",
            "No action needed: slipping is simulated. An accelerometer, or a ground that grips, "
            "makes starts surer.",
        )


def _gyros(pairs: Sequence[tuple[Estimate, mujoco.MjModel]], settings: Ground) -> Iterator[Finding]:
    """Bias, scale and latency of a gyro, against the slope of the orientation."""
    said, turned, shifts, inner = [], [], [], slice(EDGE, -EDGE)
    for estimate, model in pairs:
        for part in estimate.log.episodes():
            imu = imu_of(part, model, estimate.base)
            if imu is None or imu.gyro is None or imu.orientation is None:
                return
            slope = slopes(part.time, imu.orientation)
            said.append(convolve1d(imu.gyro, SIMPSON, axis=0)[inner])
            turned.append(slope[inner])
            shifts.append(np.gradient(slope, part.time, axis=0)[inner])
    gyro, truth, shift = (np.concatenate(parts) for parts in (said, turned, shifts))
    for axis, name in enumerate("xyz"):
        ways = np.column_stack([truth[:, axis], -shift[:, axis], np.ones(len(truth))])
        (scale, late, bias), *_ = np.linalg.lstsq(ways, gyro[:, axis], rcond=None)
        late /= scale if abs(scale) > TINY else 1.0
        spread, faster = (float(x[:, axis].std()) for x in (truth, shift))
        least = max(settings.told_share * spread, settings.told_rad)
        if abs(bias) > settings.told_rad:
            yield _imu(f"gyro.{name}", f"is off by {bias:.2g} rad/s", "subtract that")
        if abs(scale - 1) * spread > least:
            yield _imu(f"gyro.{name}", f"is {scale:.3g} times too large", f"divide by {scale:.3g}")
        if abs(late) * faster > least:
            word = "behind" if late > 0 else "ahead of"
            text = f"comes {abs(late) / MILLI:.0f} ms {word} the orientation"
            yield _imu(f"gyro.{name}", text, "look at its filter, or at the orientation's")


def _imu(where: str, what: str, fix: str) -> Finding:
    return Finding(
        "imu",
        where,
        f"`{where}` {what}, against the slope of the IMU's orientation.",
        f"Correct the log: {fix}. The estimate uses both as they are.",
    )


def _tilts(pairs: Sequence[tuple[Estimate, mujoco.MjModel]], settings: Ground) -> Iterator[Finding]:
    """How the IMU is turned on the robot, or the ground's slope: against soles that stand.

    Two soles at least stand most of the time: the turn that brings the second lowest sole nearest
    to the lowest is the one that levels the ground.
    """
    places = np.concatenate([_places(*pair) for pair in pairs])  # (T, F, 3)
    if places.shape[1] < MANY:
        return

    def apart(turn: np.ndarray) -> float:
        gap = np.sort(places[..., 2] + turn[0] * places[..., 1] - turn[1] * places[..., 0], axis=1)
        return float((gap[:, 1] - gap[:, 0]).mean())

    turn = brute(apart, 2 * [(-settings.tilt_most, settings.tilt_most)])
    better = apart(turn) < (1 - settings.told_share) * apart(np.zeros(2))
    if better and float(np.linalg.norm(turn)) > settings.told_rad:
        yield Finding(
            "imu",
            "orientation",
            f"Feet that stand are on a plane that is turned by {turn[0]:.2g} and {turn[1]:.2g} rad "
            "about x and y against what the IMU calls level: it is mounted so, or the ground "
            "slopes, or zeros of joints are off.",
            "Turn the robot round on the spot and record again: a slope turns with the ground, a "
            "mounting with the robot; correct the IMU's orientation by it.",
        )


def _places(estimate: Estimate, model: mujoco.MjModel) -> np.ndarray:
    """Return where each sole is [m], (T, F, 3), seen from the base with its heading taken out."""
    base, poses = estimate.base, estimate.qpos.copy()
    turn = poses[:, base.turn]
    poses[:, base.turn] = (back(turn) * rotations(turn)).as_quat(scalar_first=True)
    found = np.array([data.geom_xpos[base.soles] for data in posed(model, poses)])
    found -= poses[:, None, base.qpos]
    found[..., 2] -= model.geom_size[base.soles, 0]
    return found
