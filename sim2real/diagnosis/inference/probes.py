"""Values that span what an effect may be on a robot: where screening looks first.

    scale = robot_scale(data)
    probes_of(effect, neutral, scale)     # (K, P)

Each effect says them itself (`Effect.probes`), from the robot's own sizes: friction from its
motors' torque, speeds from its commands.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np

from envs.effects import Effect, RobotScale
from envs.effects.contact import touching
from envs.effects.scale import FASTEST
from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.pairs import is_scalar
from sim2real.diagnosis.data.simulate import Simulator

USUAL = 0.97  # share of the time in which a command moves no faster than what is called usual
FAST = 0.99  # share of the time in which a joint moves no faster than what it reaches
POSES = 200  # of a log at which it is looked what touches the ground
SLOWEST = 0.1  # rad/s: the speed of commands or joints that hardly move


def robot_scale(data: Data, fixed: Sequence[Fixed] = ()) -> RobotScale:
    """Return the sizes of the robot that logs were recorded on; fixed effects are in its model."""
    return RobotScale(
        data.models[0],
        [name for name in (joint.name for joint in data.joints) if name in find_scalars(data)],
        voltage=float(data.logs[0].meta.get("supply_voltage", 0.0) or 0.0),
        speeds=partial(_speeds, data),
        heat=_heats(data, tuple(fixed)),
        commands=partial(_largest_command, data),
        touching=touching(data.models[0], _poses(data)),
        bases=_bases(data),
        feels=_feels(data),
        reached=partial(_reached, data),
    )


def find_scalars(data: Data) -> set[str]:
    """Return the names of the model's hinges and slides; a base's turn is none of them."""
    model = data.models[0]
    return {model.joint(j).name for j in range(model.njnt) if is_scalar(model, j)}


def _bases(data: Data) -> list[str]:
    """Return the bodies whose own turn is compared, which no hinge or slide moves."""
    model, compared = data.models[0], {joint.name.rpartition(".")[0] for joint in data.joints}
    free = [j for j in range(model.njnt) if model.joint(j).name in compared]
    return [model.body(int(model.jnt_bodyid[j])).name for j in free]


def _feels(data: Data) -> bool:
    """Return whether an IMU said how the base is turned: its turn is compared, not its place."""
    compared = {joint.name for joint in data.joints}
    free = [name.rpartition(".")[0] for name in compared if "." in name]
    return bool(free) and not any(f"{name}.0" in compared for name in free)


def _reached(data: Data, joint: str) -> float:
    """Return how fast a joint moves in all but a hundredth of the time of all logs [rad/s]."""
    found = []
    for log in data.logs:
        if (column := f"qpos.{joint}") in log.columns:
            same = log.episode[2:] == log.episode[:-2]
            way = log.columns[column][2:] - log.columns[column][:-2]
            found.append(np.abs(way / (log.time[2:] - log.time[:-2]))[same])
    speeds = np.concatenate(found) if found else np.zeros(0)
    speeds = speeds[np.isfinite(speeds)]
    return max(float(np.quantile(speeds, FAST)), SLOWEST) if len(speeds) else FASTEST


def _poses(data: Data) -> np.ndarray:
    """Return where the robot was, at times spread over all logs, (K, nq).

    What a log does not have stands where its first window starts, or that of another one.
    """
    found, model, other = [], data.models[0], data.windows[0].recording.qpos
    for number, log in enumerate(data.logs):
        start = next((w.recording.qpos for w in data.windows if w.log == number), other)
        rows = np.linspace(0, len(log.time) - 1, min(POSES, len(log.time))).astype(int)
        poses = np.tile(start, (len(rows), 1))
        for j in range(model.njnt):
            name, first = f"qpos.{model.joint(j).name}", int(model.jnt_qposadr[j])
            own = [name] if name in log.columns else [f"{name}.{k}" for k in range(7)]
            for k, column in enumerate(c for c in own if c in log.columns):
                poses[:, first + k] = log.columns[column][rows]
        found.append(poses)
    return np.concatenate(found)


def _speeds(data: Data, actuator: str) -> tuple[float, float]:
    """Return the usual and the largest speed of an actuator's command [rad/s]."""
    found = []
    for log in data.logs:
        column = f"ctrl.{actuator}"
        if column in log.columns:
            same = np.diff(log.episode) == 0
            found.append(np.abs(np.diff(log.columns[column]) / np.diff(log.time))[same])
    if not found:
        return FASTEST, FASTEST
    usual, most = np.quantile(np.concatenate(found), (USUAL, 1.0))
    return max(float(usual), SLOWEST), float(most)


def _largest_command(data: Data, actuator: str) -> float:
    """Return an actuator's largest command without its sign, in its own unit."""
    column = f"ctrl.{actuator}"
    found = [log.columns[column] for log in data.logs if column in log.columns]
    return float(np.abs(np.concatenate(found)).max()) if found else 0.0


def _heats(data: Data, fixed: Sequence[Fixed]) -> Callable[[str], float]:
    """Return what the squared torques of simulated logs add up to; simulated when first asked."""
    names = [data.models[0].actuator(i).name for i in range(data.models[0].nactuator)]
    simulate = cache(lambda: Simulator(data, fixed).heat)

    def add_up(actuator: str) -> float:
        """Return an actuator's sum in the hardest of the logs [N²·m²·s]."""
        heat, place = simulate(), names.index(actuator)
        return max(
            float(np.trapezoid(heat.squares(number)[:, place], log.time))
            for number, log in enumerate(data.logs)
        )

    return add_up


def probes_of(effect: Effect, neutral: np.ndarray, scale: RobotScale) -> np.ndarray:
    """Return what the effect says, with the parameters it leaves out neutral, (K, P)."""
    values = np.asarray(effect.probes(scale), dtype=np.float64)
    values = values.reshape(-1, 1) if values.ndim == 1 else values
    rest = np.tile(neutral[values.shape[1] :], (len(values), 1))
    return np.column_stack([values, rest])
