"""Print what a model's fields are in mjlab under a module of terms; runs in mjlab's environment.

python mjlab_fields.py MODEL.xml EVENTS.py
"""

# pyright: reportMissingImports=false

from __future__ import annotations

import json
import runpy
import sys

import mujoco
from mjlab.actuator.xml_actuator import XmlActuatorCfg
from mjlab.entity import EntityArticulationInfoCfg, EntityCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg
from mjlab.envs.mdp import joint_pos_rel
from mjlab.envs.mdp.actions import JointPositionActionCfg
from mjlab.managers.observation_manager import ObservationGroupCfg, ObservationTermCfg
from mjlab.scene import SceneCfg

FIELDS = {
    "dof_frictionloss": "joint",
    "dof_damping": "joint",
    "dof_armature": "joint",
    "body_mass": "body",
    "geom_friction": "geom",
    "actuator_gainprm": "actuator",
    "actuator_biasprm": "actuator",
    "actuator_forcerange": "actuator",
}


def main(model: str, events: str) -> None:
    """Make two worlds of the robot with the terms, and print the second one's fields as JSON."""
    joints = [actuator.target for actuator in mujoco.MjSpec.from_file(model).actuators]
    servos = tuple(XmlActuatorCfg(target_names_expr=(joint,)) for joint in joints)
    robot = EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_file(model),
        articulation=EntityArticulationInfoCfg(actuators=servos),
    )
    seen = {"position": ObservationTermCfg(func=joint_pos_rel)}
    cfg = ManagerBasedRlEnvCfg(
        scene=SceneCfg(entities={"robot": robot}, num_envs=2),
        observations={"actor": ObservationGroupCfg(seen)},
        actions={"goal": JointPositionActionCfg(entity_name="robot", actuator_names=(".*",))},
        events=runpy.run_path(events)["events"]("robot"),
        decimation=1,
        episode_length_s=1.0,
    )
    env = ManagerBasedRlEnv(cfg=cfg, device="cpu")
    found = {}
    for field, kind in FIELDS.items():
        values = getattr(env.sim.model, field)[1].tolist()
        places = env.sim.mj_model.dof_jntid if kind == "joint" else range(len(values))
        names = [getattr(env.sim.mj_model, kind)(int(place)).name for place in places]
        named = zip(names, values, strict=True)
        found[field] = {name.removeprefix("robot/"): value for name, value in named}
    bias = env.scene["robot"].data.encoder_bias[1].tolist()
    found["encoder_bias"] = dict(zip(env.scene["robot"].joint_names, bias, strict=True))
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
