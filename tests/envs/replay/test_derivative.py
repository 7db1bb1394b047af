"""A derivative gain on the error, beside a loop over MuJoCo written by hand."""

import mujoco
import numpy as np

from envs.plant import Plant
from envs.replay import Recording, replay, switchable
from envs.replay.derivative import FILTER, add_derivatives

KP, KD, GEAR, LIMIT, DT = 6.0, 0.03, 2.0, 3.0, 0.002
SERVO = f'<position name="lift" joint="arm" kp="{KP}" kv="{KD}" gear="2" forcerange="-3 3"/>'
ARM = f"""<mujoco>
  <option timestep="{DT}"/>
  <custom><numeric name="derivative_time.lift" data="{KD / KP}"/></custom>
  <worldbody><body><joint name="base" axis="0 0 1" armature="0.02"/><geom size="0.05" mass="0.3"/>
    <body pos="0.1 0 0"><joint name="arm" axis="0 1 0" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/></body></body>
  </worldbody>
  <actuator><position name="turn" joint="base" kp="4" kv="0.2"/>{SERVO}</actuator>
</mujoco>"""


def by_hand(goals: np.ndarray) -> np.ndarray:
    """Return the path (K, 2) at goals (K, 2), the arm driven by the law itself."""
    bare = ARM.replace(SERVO, "").replace("derivative_time.lift", "of_nothing")
    model = mujoco.MjModel.from_xml_string(bare)
    data, path, rate = mujoco.MjData(model), [], 0.0
    for now, before in zip(goals, np.vstack([goals[:1], goals[:-1]]), strict=True):
        path.append(data.qpos.copy())
        data.ctrl[0] = now[0]
        rate += ((now[1] - before[1]) / DT - rate) * DT / (FILTER + DT)
        force = KP * (now[1] - GEAR * data.qpos[1]) + KD * (rate - GEAR * data.qvel[1])
        data.qfrc_applied[1] = GEAR * np.clip(force, -LIMIT, LIMIT)
        mujoco.mj_step(model, data)
    return np.array(path)


def test_a_goal_that_moves_is_ahead_of_itself_within_the_limit_of_force() -> None:
    """A replay has the path of the law kp e + kd de/dt, and another one without its number."""
    time, rng = np.arange(50) * 0.02, np.random.default_rng(0)
    goals = np.cumsum(rng.normal(0.0, 0.05, (50, 2)), axis=0)
    every = np.repeat(goals, round(0.02 / DT), axis=0)
    recording = Recording(time, goals, np.zeros(2), np.zeros(2))
    paths = []
    for text in (ARM, ARM.replace("derivative_time.lift", "of_nothing")):
        spec = mujoco.MjSpec.from_string(text)
        paths.append(replay(Plant(switchable(spec), threads=1), [recording])[0])
    expected = by_hand(every)[:: round(0.02 / DT)]
    np.testing.assert_allclose(paths[0], expected, atol=1e-9)
    assert np.abs(paths[1] - expected).max() > 0.01


def test_models_without_a_derivative_time_get_their_commands_as_they_are() -> None:
    """Without any number nothing is copied; with one, an old command still has its effect."""
    model = mujoco.MjModel.from_xml_string(ARM)
    none = mujoco.MjModel.from_xml_string(ARM.replace("derivative_time.lift", "of_nothing"))
    ctrl = np.zeros((1, 3, 2))
    assert add_derivatives(none, ctrl, np.ones((1, 2))) is ctrl
    ahead = add_derivatives(model, ctrl, np.ones((1, 2)))[0]
    share = DT / (FILTER + DT)
    np.testing.assert_allclose(ahead[:, 0], 0.0)
    np.testing.assert_allclose(ahead[:, 1], -KD / KP / DT * share * (1 - share) ** np.arange(3))
