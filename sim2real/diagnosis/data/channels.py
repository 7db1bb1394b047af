"""A log's channels other than positions, and a simulation's gap in them: speeds, torques, IMUs.

    gaps = channel_gaps(data, known, found)     # before and after the effects that were found

A diagnosis is fitted to positions alone. Every other channel that the log has is then a witness of
its own: each is compared over its own noise, and a cause that brings the positions closer and
another channel further off is doubtful. Compared are

* `qvel.<joint>`: the speed of the simulated joint;
* `current.<actuator>` and a column of torque: the actuator's torque, times the one factor that fits
  it best (the motor's constant is not known); a torque that was computed is left out;
* `gyro.<site>.x` to `.z` and `accelerometer.<site>.x` to `.z`: MuJoCo's sensors at that site.

Noise is that of one reading (`noise_floor`).
"""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from envs.plant import Fixed
from envs.replay import Schedule
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.noise_floor import reading_noise
from sim2real.diagnosis.data.pairs import is_scalar
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.data.thermal import torques
from sim2real.diagnosis.evidence import ChannelGap
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY, Preflight

AXES, SITE = ("x", "y", "z"), mujoco.mjtObj.mjOBJ_SITE
SENSORS = {
    "gyro": mujoco.mjtSensor.mjSENS_GYRO,
    "accelerometer": mujoco.mjtSensor.mjSENS_ACCELEROMETER,
}
UNITS = {"qvel": "rad/s", "gyro": "rad/s", "accelerometer": "m/s²", "current": "A"}


def channel_gaps(
    data: Data, known: Sequence[Fixed], found: Sequence[Fixed] | None, torque: dict[str, str]
) -> tuple[ChannelGap, ...]:
    """Return how far every channel but the positions is off, before and after.

    Args:
        data: the windows.
        known: effects that are part of the model.
        found: the same and those that were found; None where none were.
        torque: the column that is a measured torque or current of each actuator.
    """
    kinds = {column.partition(".")[0] for log in data.logs for column in log.columns}
    if not torque and not kinds & {"qvel", *SENSORS}:
        return ()
    before = _residuals(data, known, torque)
    after = before if found is None else _residuals(data, found, torque)
    noise = {column: reading_noise(data.logs, column, data.settings) for column in before}
    units = {column: UNITS.get(column.partition(".")[0], "N·m") for column in before}
    return tuple(ChannelGap(c, units[c], noise[c], before[c], after[c]) for c in before)


def contradicting(
    gaps: Sequence[ChannelGap], settings: Preflight = DEFAULT.preflight
) -> Iterator[Finding]:
    """Yield a finding for each channel whose error the causes increase."""
    for gap in gaps:
        far = gap.after - gap.before > settings.sigmas * gap.noise
        if far and gap.after > settings.ratio[1] * gap.before:
            yield Finding(
                "witness",
                gap.column.partition(".")[2],
                f"Nothing was fitted to `{gap.column}`, and the causes bring it further off: "
                f"{gap.after:.3g} {gap.unit} with them, {gap.before:.3g} without.",
                "Doubt the causes, or this channel's unit, sign and filter.",
            )


def _residuals(data: Data, fixed: Sequence[Fixed], torque: dict[str, str]) -> dict[str, float]:
    """Return the root mean square residual of each column over the compared rows."""
    both: dict[str, list[np.ndarray]] = {}
    simulator, imus = Simulator(data, fixed), [_with_sensors(data, spec) for spec in data.specs]
    for number, log in enumerate(data.logs):
        windows = [window for window in data.windows if window.log == number]
        own = {name: column for name, column in torque.items() if column in log.columns}
        for window, (model, path, plan, _) in zip(windows, simulator.paths(number), strict=True):
            rows, imu = window.first + np.flatnonzero(window.usable), imus[window.model]
            since = log.time[rows] - log.time[window.start]
            steps = np.round(since / model.opt.timestep).astype(int)
            if np.isfinite(path).all() and steps.size:
                steps = np.clip(steps, 1, len(path) - 2)
                made = _simulated(model, plan, path, steps, own)
                made |= _sensed(imu, path, steps) if imu.nsensor else {}
                for column in [name for name in made if name in log.columns]:
                    pair = np.stack([log.column(column)[rows], made[column]])
                    both.setdefault(column, []).append(pair)
    return {column: _rms(np.concatenate(pairs, axis=1), column) for column, pairs in both.items()}


def _rms(both: np.ndarray, column: str) -> float:
    """Return the root mean square difference of two lines, (2, n); a torque is scaled to fit."""
    measured, simulated = both
    if column.partition(".")[0] in ("current", "sensor"):
        factor = float(measured @ simulated) / max(float(simulated @ simulated), TINY)
        simulated = factor * simulated
    return float(np.sqrt(np.mean((measured - simulated) ** 2)))


def _simulated(
    model: mujoco.MjModel,
    plan: Schedule,
    path: np.ndarray,
    steps: np.ndarray,
    torque: dict[str, str],
) -> dict[str, np.ndarray]:
    """Return what a simulation makes of speeds and torques at some steps (n,) of its path."""
    found: dict[str, np.ndarray] = {}
    for i in range(model.njnt):
        if is_scalar(model, i):
            place = int(model.jnt_qposadr[i])
            slope = (path[steps + 1, place] - path[steps - 1, place]) / 2
            found[f"qvel.{model.joint(i).name}"] = slope / model.opt.timestep
    if torque:
        every = torques(model, path, plan)
        for name, column in torque.items():
            found[column] = every[steps, model.actuator(name).id]
    return found


def _with_sensors(data: Data, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Return a model whose only sensors are the IMUs that the logs have."""
    spec = spec.copy()
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    columns = {name.rpartition(".")[0] for log in data.logs for name in log.columns}
    sites = {site.name for site in spec.sites}
    for kind, _, site in sorted(column.partition(".") for column in columns):
        if kind in SENSORS and site in sites:
            spec.add_sensor(name=f"{kind}.{site}", type=SENSORS[kind], objtype=SITE, objname=site)
    return spec.compile()


def _sensed(model: mujoco.MjModel, path: np.ndarray, steps: np.ndarray) -> dict[str, np.ndarray]:
    """Return what IMUs say along positions (K + 1, nq) at some steps (n,), by column."""
    data, dt = mujoco.MjData(model), model.opt.timestep
    rows = np.empty((len(steps), model.nsensordata))
    speeds = np.empty((2, model.nv))
    for row, step in enumerate(steps.tolist()):
        for side in range(2):
            first, after = path[step - 1 + side], path[step + side]
            mujoco.mj_differentiatePos(model, speeds[side], dt, first, after)
        data.qpos[:], data.qvel[:] = path[step], speeds.mean(axis=0)
        data.qacc[:] = (speeds[1] - speeds[0]) / dt
        mujoco.mj_inverse(model, data)
        rows[row] = data.sensordata
    return {
        f"{model.sensor(i).name}.{axis}": rows[:, int(model.sensor_adr[i]) + k]
        for i in range(model.nsensor)
        for k, axis in enumerate(AXES)
    }
