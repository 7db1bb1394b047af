"""A trained policy on the robot: what the verb `deploy` is made of.

    env = on_robot(trained, task, backend, out / "logs")      # see robot_env.py
    drive(env, trained, deployment, out)              # the episodes that are left; then it parks
    report(deployment, trained, task, out)            # returns on the robot, and in its simulator

After each episode all is on disk, so that what was interrupted goes on with `load`.
"""

import json
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from torchrl.envs import TransformedEnv

from envs.mujoco import MujocoEnv
from envs.tasks.servo import ServoTask
from envs.unactuated import unobservable_joints_message
from hardware.backends import Backend
from hardware.errors import SafetyError
from hardware.rows import RobotRows
from sim2real.deployment.fit import check_interface
from sim2real.deployment.robot_env import play, robot_of
from sim2real.deployment.session import STATE, Deployment, EpisodePlan, save
from sim2real.deployment.trained import task_of
from sim2real.learning.adapt import Adaptation, IdentifySession
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.errors import RunInterrupted, Sim2RealError
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, bootstrap, mean
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
DRAWS = 2000  # resamples of an interval
LINK = "link.json"  # periods, overruns and answers since the deployment began or went on


def servo_task(environment: EnvironmentFactory) -> ServoTask:
    """Return an environment's task; raises Sim2RealError if it is not one of a servo robot."""
    task = task_of(environment)
    if not isinstance(task, ServoTask):
        raise Sim2RealError(
            f"{type(task).__name__} is not a task of a servo robot; give a checkpoint of one, such "
            "as those of env=bench1, env=hopper2 or env=quad8"
        )
    return task


def check_reward(rows: RobotRows, adapt: Adaptation) -> None:
    """Refuse to adapt by returns that cannot be measured."""
    lacking = rows.needs()[1] - set(rows.backend.sensor_names)
    if lacking and adapt.episodes and not adapt.needs_log:
        raise Sim2RealError(
            f"the reward of {type(rows.task).__name__} needs {', '.join(sorted(lacking))}, which "
            f"{rows.backend.robot.name} does not measure, so its returns cannot guide an "
            "adaptation; give adapt=none, or a tracker (hardware/body.py)"
        )


def check_base(rows: RobotRows, adapt: Adaptation) -> None:
    """Refuse to identify a robot whose logs do not tell where its base is."""
    if not adapt.needs_log:
        return
    why = unobservable_joints_message(
        rows.task.spec().compile(), has_imu=has_base_orientation(rows.backend)
    )
    if why:
        raise Sim2RealError(
            f"adapt=identify replays a robot's logs, but {rows.backend.robot.name} {why}; choose "
            "another adapt, such as adapt=batch, or identify the robot while its base is held "
            "(run=identify)"
        )


def has_base_orientation(backend: Backend) -> bool:
    """Return whether a robot's logs say how its base is turned, by an IMU at a known site."""
    senses = set(backend.sensor_names)
    enough = "orientation" in senses or {"gyro", "acceleration"} <= senses
    return enough and backend.robot.imu is not None


def run_deployment(
    env: TransformedEnv,
    trained: TrainedPolicy,
    deployment: Deployment,
    out: Path,
    measure: Callable[[EpisodePlan], float] | None = None,
    resume: Path | None = None,
) -> None:
    """Run the episodes that are left, and park.

    Args:
        env: the robot, see `on_robot`.
        trained: the policy.
        deployment: which episodes are left.
        out: gets state.npz, returns.csv and link.json after each episode, and parameters.csv where
            the robot's are identified.
        measure: what is added to the return of an episode, such as the distance that somebody
            measured; None for nothing.
        resume: the folder that a message says to continue; None for `out`.

    Raises:
        Sim2RealError: the policy was trained for another robot, before anything moves.
        SafetyError: the guard stopped the robot; what was done is on disk.
        RunInterrupted: after Ctrl-C; torque is off.
    """
    again, rows = f"continue with resume={resume or out}", robot_of(env)
    check_interface(trained, rows.backend.robot)
    save(out / STATE, deployment)
    try:
        rows.arm()
        while (turn := deployment.next()) is not None:
            rows.facts = policy_metadata(trained) if turn.phase == "before" else {}
            explores, actor = deployment.explores(turn), trained.acting(env, turn.theta)
            value, steps = play(env, actor, turn.seed, explores)
            rows.finish()  # where a transform ended the episode before its task
            if rows.stopped is not None:
                raise SafetyError(
                    f"{rows.stopped} (in episode {deployment.done + 1} of {deployment.total}); "
                    f"remove the cause, then {again}"
                )
            value += 0.0 if measure is None else measure(turn)
            deployment.tell(value, steps, rows.log.last)
            save(out / STATE, deployment)
            write_text(out / "returns.csv", list_returns(deployment).csv())
            if isinstance(deployment.session, IdentifySession):
                write_text(
                    out / "parameters.csv", identified_parameters_table(deployment.session).csv()
                )
            if rows.link is not None:
                facts = json.dumps(rows.link.as_dict(), indent=1, ensure_ascii=False)
                write_text(out / LINK, facts + "\n")
            text = "%s, episode %d: return %.4g; %s"
            log_.info(text, turn.phase, turn.number + 1, value, rows.link)
        log_.info("all %d episodes are done; %s", deployment.total, rows.link)
    except KeyboardInterrupt:
        rows.close()  # its log then says that this ended the episode
        done = f"stopped after {deployment.done} of {deployment.total} episodes, torque is off"
        raise RunInterrupted(f"{done}; {again}", 130) from None
    finally:
        env.close()


def read_link(folder: Path) -> dict[str, Any] | None:
    """Return the content of a deployment's link.json, see `hardware/link.py`; None without one."""
    path = folder / LINK
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def policy_metadata(trained: TrainedPolicy) -> dict[str, Any]:
    """Return a log's metadata that name the policy which made it."""
    return {} if trained.source is None else {"policy": str(trained.source.resolve())}


def list_returns(deployment: Deployment) -> Table:
    """Return a row for each episode so far."""
    table = Table(("phase", "episode", "return"))
    phases = {
        "as trained": deployment.before,
        "adapting": deployment.adapting,
        "adapted": deployment.after,
    }
    for phase, values in phases.items():
        for number, value in enumerate(values, 1):
            table.add(phase, number, value)
    return table


def identified_parameters_table(session: IdentifySession) -> Table:
    """Return the robot's parameters as they were known after each episode, each in its unit."""
    table = Table(("episode", *session.names))
    for number, values in enumerate(session.history, 1):
        table.add(number, *map(float, values))
    return table


def simulate_returns(
    trained: TrainedPolicy, task: ServoTask, theta: np.ndarray, seeds: np.ndarray
) -> list[float]:
    """Return a policy's returns in its own simulator from the same starts."""
    env = trained.over(partial(MujocoEnv, task))
    try:
        actor = trained.acting(env, theta)
        return [play(env, actor, int(seed))[0] for seed in seeds]
    finally:
        env.close()


def report(deployment: Deployment, trained: TrainedPolicy, task: ServoTask, out: Path) -> Table:
    """Write table.md and table.csv: returns on the robot, and in the simulator, by phase."""
    columns = ("policy", "episodes", "return on the robot", "return in its simulator")
    table = Table(columns)
    rng = np.random.default_rng([deployment.seed, DRAWS])
    phases = [("as trained", deployment.before, deployment.theta)]
    if deployment.adapts:
        name = f"after {deployment.adapt.episodes} episodes of adaptation"
        phases.append((name, deployment.after, deployment.session.result))
    for name, returns, theta in phases:
        twin = simulate_returns(trained, task, theta, deployment.fresh)
        table.add(name, len(returns), estimate(returns, rng), estimate(twin, rng))
    if len(deployment.fresh) > 1:
        note = (
            "Means, with 95 % bootstrap intervals over the episodes, which start alike everywhere."
        )
        table.notes.append(note)
    table.write(out / "table")
    return table


def estimate(returns: list[float], rng: np.random.Generator) -> Interval | float:
    """Return the mean of returns, with an interval if there are several."""
    if len(returns) < 2:
        return returns[0]
    return bootstrap(np.array(returns)[:, None], mean, rng, draws=DRAWS, resample="rows")


def draw(rows: RobotRows, deployment: Deployment, folder: Path) -> None:
    """Draw the returns of all episodes, and commands and measurements of the last."""
    with figure(folder / "returns.png", 1, 1, (6.4, 3.2)) as (_, axes):
        panel, start = axes[0, 0], 1
        names = {"before": "as trained", "adapting": "adapting", "after": "adapted"}
        for colour, (key, name) in zip(COLOURS, names.items(), strict=False):
            values = getattr(deployment, key)
            if values:
                place = np.arange(start, start + len(values))
                panel.plot(place, values, "o-", color=colour, label=name)
            if key == "adapting" and values:
                best = np.maximum.accumulate(values)
                panel.step(place, best, where="post", color=INK, lw=1, label="best so far")
            start += len(values)
        panel.set_xlabel("episode on the robot")
        panel.set_ylabel("return")
        panel.legend()
    log = rows.log.last
    if log is None:
        return
    count = len(rows.names)
    with figure(folder / "log.png", count, 1, (8.0, 1.0 + 1.3 * count)) as (_, axes):
        for panel, name, joint in zip(axes[:, 0], log.actuators, log.joints, strict=True):
            panel.plot(log.time, log.column(f"action.{name}"), color=COLOURS[5], label="asked for")
            panel.plot(log.time, log.column(f"ctrl.{name}"), color=COLOURS[0], label="sent")
            panel.plot(log.time, log.column(f"qpos.{joint}"), color=INK, label="measured")
            panel.set_ylabel(f"{joint} (rad)")
        axes[0, 0].legend(loc="upper right")
        axes[-1, 0].set_xlabel("time (s)")
