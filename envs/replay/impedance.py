"""Joints under impedance control: each row of a recording has its own gains.

    spec = with_impedance(spec, {"knee": (20.0, 0.5)})        # what the replay engine can drive
    recording = recording._replace(law=law)                   # (T, nu, 4)

Motors that are driven in "MIT mode" take five numbers a row, and close their loop themselves:

    torque = kp (q_des - q) + kd (w_des - w) + torque_ff

The desired position is the command. The model's actuator becomes an affine one with reference gains
and a bias of 1 N·m; at each physics step the row in force scales them. So every effect acts on such
a joint as on any servo: `position_gain` on kp, `derivative_gain` on kd, `motor_strength` on all of
the torque, and `command_delay` delays the whole row. Source: B. Katz, A low cost modular actuator
for dynamic robots (MIT, 2018), section 4; the torque in the actuator's own terms, MuJoCo XML
reference, actuator/general.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from envs.effects.places import joint_driven
from envs.effects.servo import is_linear
from envs.errors import TaskError
from envs.plant import Plant

MARK = "impedance"  # name of the text in a model that lists its actuators under impedance control
REFERENCE = 1.0  # the gain of a law that is 0 throughout
GAIN, SPEED, FORCE = 1, 2, 0  # places in a bias: of position, speed, and constant


def with_impedance(spec: mujoco.MjSpec, gains: Mapping[str, tuple[float, float]]) -> mujoco.MjSpec:
    """Return a copy of the spec whose named actuators can be given laws.

    Args:
        spec: the robot.
        gains: reference kp and kd of each, in the actuator's own terms (at a gear of 1 N·m/rad and
            N·m·s/rad).

    Raises:
        TaskError: an actuator that is not affine, or acts on no joint.
    """
    spec, model = spec.copy(), spec.copy().compile()
    named = {model.actuator(i).name: i for i in range(model.nactuator)}
    for actuator in spec.actuators:
        if actuator.name not in gains:
            continue
        index = named[actuator.name]
        if (
            not (is_linear(model, index) and joint_driven(model, index))
            or model.actuator_actnum[index]
        ):
            raise TaskError(
                f"actuator {actuator.name!r} of the model cannot have impedance control, which "
                f"needs a motor or a position actuator on a joint"
            )
        _limit(actuator, model, index)
        kp, kd = (gain if gain > 0 else REFERENCE for gain in gains[actuator.name])
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm = _first(kp)
        actuator.biasprm = _first(1.0, -kp, -kd)
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
    for text in [text for text in spec.texts if text.name == MARK]:
        spec.delete(text)
    if gains:
        spec.add_text(name=MARK, data=" ".join(gains))
    return spec


def without_impedance(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of the spec whose actuators under impedance control are plain servos."""
    spec = spec.copy()
    marks = [text for text in spec.texts if text.name == MARK]
    names = {name for text in marks for name in text.data.split()}
    for actuator in spec.actuators:
        if actuator.name in names:
            actuator.biasprm = _first(0.0, *actuator.biasprm[1:3])
    for text in marks:
        spec.delete(text)
    return spec


def _limit(actuator: mujoco.MjsActuator, model: mujoco.MjModel, index: int) -> None:
    """Let a motor whose command is limited keep that limit on its torque."""
    motor = model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_NONE
    if motor and model.actuator_ctrllimited[index] and not model.actuator_forcelimited[index]:
        force = model.actuator_ctrlrange[index] * model.actuator_gainprm[index, 0]
        actuator.forcelimited, actuator.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, force


def _first(*values: float) -> list[float]:
    return [*map(float, values), *[0.0] * (mujoco.mjNGAIN - len(values))]


def impedances(model: mujoco.MjModel) -> np.ndarray:
    """Return the actuators of a model that are under impedance control, (k,)."""
    text = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, MARK)
    if text < 0:
        return np.zeros(0, dtype=int)
    first, size = int(model.text_adr[text]), int(model.text_size[text])
    names = bytes(model.text_data)[first : first + size].decode().rstrip("\0").split()
    return np.array([model.actuator(name).id for name in names], dtype=int)


class ImpedanceGains:
    """Brings the actuators of a plant to the laws of each physics step.

    Args:
        plant: N rows, with the effects' values in force.
        law: kp, kd, desired speed and feed-forward in force at each step, (N, K, nu, 4); None: the
            reference gains of the model throughout, as for a plain servo.
    """

    def __init__(self, plant: Plant, law: np.ndarray | None) -> None:
        self._plant, self.index = plant, impedances(plant.model)
        if not self.index.size:
            return
        model, every = plant.model, np.arange(plant.num_rows)
        reference = -model.actuator_biasprm[self.index][:, [GAIN, SPEED]]  # (k, 2)
        if law is None:
            plain = np.concatenate([reference, np.zeros_like(reference)], axis=1)
            self._law = np.broadcast_to(plain, (plant.num_rows, 1, *plain.shape))
        else:
            self._law = law[:, :, self.index]
        self._reference = reference
        self._gain = plant.field("actuator_gainprm").copy()  # (N, nu, 10), as effects left them
        self._bias = plant.field("actuator_biasprm").copy()
        delay = plant.field_values("actuator_delay", every)[:, self.index]
        dt = model.opt.timestep
        self._late = np.where(delay > 0, np.maximum(delay, dt), 0.0) / dt  # (N, k) steps
        self._last: np.ndarray | None = None

    @property
    def steady(self) -> bool:
        """Whether one law holds throughout, so that the engine can take all steps at once."""
        return not self.index.size or bool((self._law == self._law[:, :1]).all())

    def act(self, step: int) -> None:
        """Put the law of a step into the plant's actuators."""
        if not self.index.size:
            return
        count = self._law.shape[1]
        sent = np.clip(np.floor(step - self._late + 1e-9).astype(int), 0, count - 1)  # (N, k)
        rows, columns = np.arange(len(sent))[:, None], np.arange(len(self.index))
        law = self._law[rows, sent, columns]  # (N, k, 4)
        if self._last is not None and (law == self._last).all():
            return
        self._last = law
        scale = law[..., :2] / self._reference
        gain, bias = self._gain.copy(), self._bias.copy()
        gain[:, self.index, 0] *= scale[..., 0]
        bias[:, self.index, GAIN] *= scale[..., 0]
        bias[:, self.index, SPEED] *= scale[..., 1]
        forward = bias[:, self.index, FORCE] * law[..., 3]
        bias[:, self.index, FORCE] = forward - bias[:, self.index, SPEED] * law[..., 2]
        self._hold(gain, bias)

    def restore(self) -> None:
        """Bring the reference gains back."""
        if self.index.size:
            self._hold(self._gain, self._bias)
            self._last = None

    def _hold(self, gain: np.ndarray, bias: np.ndarray) -> None:
        every = np.arange(self._plant.num_rows)
        self._plant.override_field("actuator_gainprm", every, gain)
        self._plant.override_field("actuator_biasprm", every, bias)
