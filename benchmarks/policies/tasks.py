"""Robots as other libraries' users see them: an observation, an action law, and its OBS.yaml.

    one = POLICIES["rsl_rl"]
    task, about, actor = one.task(), one.about(), one.actor()

Each task is one of ours with another interface: what the policy sees and what becomes of its
action follow the description and nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import yaml

from envs.tasks import Follow, Hopper2, Quad8
from envs.tasks.base import State
from envs.tasks.servo import ServoTask
from envs.tasks.servo.base import clock, commanded
from envs.tasks.servo.legs import joints
from sim2real.deployment.actors import LoadedPolicy, load_actor
from sim2real.diagnosis.contract.description import Description, read_description

FOLDER = Path(__file__).parent
OWN = FOLDER / "quad12"  # a policy of ours, as exported
ARM = Path(__file__).parents[2] / "conf/robot/arm6.yaml"
SERVO = "xl430-w250"  # of the arm, in place of larger ones
SECONDS = 3.0  # of a walk
LEGS_SCALE, LEG_SCALE, ARM_SCALE = 0.25, 0.4, 0.5  # rad per 1 of an action


class AboutPose(ServoTask):
    """A task whose goals and angles are relative to the pose at home."""

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off that pose."""
        super().setup(model)
        self.pose = self.rest(model)


class Bower(AboutPose, Quad8):
    """Quad8 that crouches and leans as commanded, with legged_gym's observation (32,).

    Scaled terms, gravity, a default pose, a command of two numbers. Reward: -(mean |error|) dt.
    """

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return how far a network's mean may go, (8,) each."""
        return np.full(8, -4.0), np.full(8, 4.0)

    def asked(self, time: np.ndarray) -> np.ndarray:
        """Return the command at times (n,): how far to crouch and to lean [rad], (n, 2)."""
        return np.stack([0.3 * np.sin(4.4 * time), 0.2 * np.sin(6.9 * time)], axis=1)

    def target_angles(self, state: State, action: np.ndarray) -> np.ndarray:
        """Return the default pose and a share of the action [rad], (n, 8)."""
        return self.pose + LEGS_SCALE * action

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return -(mean |error|) dt [rad s], (n,)."""
        crouch, lean = self.asked(commanded(after).time).T
        extension = -crouch[:, None] + lean[:, None] * np.array([1.0, 1.0, -1.0, -1.0])
        goal = joints(np.zeros_like(extension), extension, self.home_bend)
        return -np.abs(after.qpos[:, self.q] - goal).mean(axis=1) * self.dt

    def observe(self, state: State) -> np.ndarray:
        """Return (gyro, gravity, command, angles, speeds, last action), (n, 32)."""
        command = commanded(state)
        seen = [
            0.25 * state.qvel[:, 3:6],
            down(state.qpos[:, 3:7]),
            2.0 * self.asked(command.time + self.dt),
            state.qpos[:, self.q] - self.pose,
            0.05 * state.qvel[:, self.v],
            command.action,
        ]
        return np.concatenate(seen, axis=1)


class Leg(AboutPose, Hopper2):
    """Hopper2 whose goals are angles: a frame (8,) of angles, speeds, a clock, the last action."""

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and largest actions, (2,) each."""
        return np.full(2, -1.0), np.full(2, 1.0)

    def target_angles(self, state: State, action: np.ndarray) -> np.ndarray:
        """Return the default pose and a share of the action [rad], (n, 2)."""
        return self.pose + LEG_SCALE * np.clip(action, -1.0, 1.0)

    def observe(self, state: State) -> np.ndarray:
        """Return (angles, speeds, sine and cosine of the clock, last action), (n, 8)."""
        phase = clock(state, self.gait.frequency)
        rhythm = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        angle, speed = state.qpos[:, self.q] - self.pose, 0.1 * state.qvel[:, self.v]
        return np.concatenate([angle, speed, rhythm, commanded(state).action], axis=1)


class Pointer(AboutPose, Follow):
    """An arm that follows sines, whose goals are angles about its pose at home."""

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return how far a network's mean may go, (n,) each."""
        return np.full(model.nu, -4.0), np.full(model.nu, 4.0)

    def target_angles(self, state: State, action: np.ndarray) -> np.ndarray:
        """Return the default pose and a share of the action [rad], (n, servos)."""
        return self.pose + ARM_SCALE * action

    def observe(self, state: State) -> np.ndarray:
        """Return (angles, speeds, the reference one step later, last action), (n, 4 servos)."""
        command = commanded(state)
        ahead = self.reference(command.time + self.dt) - self.pose
        angle, speed = state.qpos[:, self.q] - self.pose, 0.2 * state.qvel[:, self.v]
        return np.concatenate([angle, speed, ahead, command.action], axis=1)


def down(quaternion: np.ndarray) -> np.ndarray:
    """Return the direction of gravity in the body's frame, (n, 3), of w x y z (n, 4)."""
    w, x, y, z = quaternion.T
    return -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w**2 - x**2 - y**2 + z**2], axis=1)


def arm(kind: type[Follow], seconds: float) -> Follow:
    """Return a task of arm6, here with six small servos."""
    robot = yaml.safe_load(ARM.read_text(encoding="utf-8"))
    robot["servos"] = {n: {**one, "model": SERVO} for n, one in robot["servos"].items()}
    return kind(robot=robot, model="arm6.xml", seconds=seconds)


@dataclass(frozen=True)
class Policy:
    """A policy of another library."""

    library: str  # that trained it; also the name of its files
    robot: str  # what it drives
    task: Callable[[], ServoTask]  # makes its task

    @property
    def file(self) -> Path:
        """The policy."""
        return FOLDER / f"{self.library}.onnx"

    @property
    def observation(self) -> Path:
        """Its description."""
        return FOLDER / f"{self.library}.yaml"

    def about(self, joints: list[str]) -> Description:
        """Read its description."""
        return read_description(self.observation, joints)

    def actor(self) -> LoadedPolicy:
        """Read the policy."""
        return load_actor(self.file)


POLICIES = {
    one.library: one
    for one in (
        Policy("stable_baselines3", "hopper2", lambda: Leg(seconds=SECONDS)),
        Policy("rsl_rl", "quad8", lambda: Bower(seconds=SECONDS)),
        Policy("skrl", "arm6", lambda: arm(Pointer, SECONDS)),
    )
}
