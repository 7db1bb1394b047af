"""Compiled models and their states."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from mujoco._fields import (
    ArrayLike,
    Int,
    NDArray,
    _Bools,
    _Field,
    _Float,
    _Floats,
    _Int,
    _Ints,
    _Singles,
)

class MjModel:
    _setconst_outputs: ClassVar[Any]  # of `mujoco.batch`: fields that `set_const` derives
    def actuator(self, name: str | Int, /) -> _MjModelActuatorViews: ...
    actuator_actadr: _Ints
    actuator_actlimited: _Bools
    actuator_actnum: _Ints
    actuator_actrange: _Floats
    actuator_armature: _Floats
    actuator_biasprm: _Floats
    actuator_biastype: _Ints
    actuator_ctrladr: _Ints
    actuator_ctrllimited: _Bools
    actuator_ctrlnum: _Ints
    actuator_ctrlrange: _Floats
    actuator_damping: _Floats
    actuator_dynprm: _Floats
    actuator_dyntype: _Ints
    actuator_delay: _Floats
    actuator_forcelimited: _Bools
    actuator_forcerange: _Floats
    actuator_gainprm: _Floats
    actuator_gaintype: _Ints
    actuator_gear: _Floats
    actuator_group: _Ints
    actuator_history: _Ints
    actuator_historyadr: _Ints
    actuator_trnid: _Ints
    actuator_trntype: _Ints
    def bind(self, specs: Any) -> Any: ...
    def body(self, name: str | Int, /) -> _MjModelBodyViews: ...
    body_simple: _Field[NDArray[np.uint8], ArrayLike]
    body_inertia: _Floats
    body_ipos: _Floats
    body_iquat: _Floats
    body_jntadr: _Ints
    body_jntnum: _Ints
    body_mass: _Floats
    body_parentid: _Ints
    body_pos: _Floats
    body_quat: _Floats
    body_rootid: _Ints
    body_subtreemass: _Floats
    body_weldid: _Ints
    cam_fovy: _Floats
    cam_projection: _Ints
    cam_quat: _Floats
    def camera(self, name: str | Int, /) -> _MjModelCameraViews: ...
    dof_M0: _Floats
    dof_armature: _Floats
    dof_bodyid: _Ints
    dof_jntid: _Ints
    dof_damping: _Floats
    dof_frictionloss: _Floats
    dof_invweight0: _Floats
    dof_solimp: _Floats
    def exclude(self, name: str | Int, /) -> _MjModelExcludeViews: ...
    @staticmethod
    def from_binary_path(
        filename: str, assets: Mapping[str, bytes] | None = ..., vfs: Any = ...
    ) -> MjModel: ...
    @staticmethod
    def from_xml_path(
        filename: str, assets: Mapping[str, bytes] | None = ..., vfs: Any = ...
    ) -> MjModel: ...
    @staticmethod
    def from_xml_string(
        xml: str, assets: Mapping[str, bytes] | None = ..., vfs: Any = ...
    ) -> MjModel: ...
    def geom(self, name: str | Int, /) -> _MjModelGeomViews: ...
    geom_aabb: _Floats
    geom_bodyid: _Ints
    geom_conaffinity: _Ints
    geom_condim: _Ints
    geom_contype: _Ints
    geom_fluid: _Floats
    geom_friction: _Floats
    geom_group: _Ints
    geom_margin: _Floats
    geom_matid: _Ints
    geom_pos: _Floats
    geom_priority: _Ints
    geom_quat: _Floats
    geom_rbound: _Floats
    geom_rgba: _Singles
    geom_size: _Floats
    geom_solref: _Floats
    geom_type: _Ints
    jnt_axis: _Floats
    jnt_bodyid: _Ints
    jnt_dofadr: _Ints
    jnt_limited: _Bools
    jnt_pos: _Floats
    jnt_qposadr: _Ints
    jnt_range: _Floats
    jnt_stiffness: _Floats
    jnt_type: _Ints
    def joint(self, name: str | Int, /) -> _MjModelJointViews: ...
    def key(self, name: str | Int, /) -> _MjModelKeyframeViews: ...
    key_ctrl: _Floats
    key_qpos: _Floats
    light_active: _Bools
    mat_rgba: _Singles
    mat_texid: _Ints
    mat_texrepeat: _Singles
    @property
    def na(self) -> int: ...
    @property
    def nactuator(self) -> int: ...
    @property
    def names(self) -> bytes: ...
    @property
    def neq(self) -> int: ...
    @property
    def ngravcomp(self) -> int: ...
    @property
    def nmesh(self) -> int: ...
    @property
    def nbody(self) -> int: ...
    @property
    def nbuffer(self) -> int: ...
    @property
    def ncam(self) -> int: ...
    @property
    def nflex(self) -> int: ...
    @property
    def ngeom(self) -> int: ...
    @property
    def nhistory(self) -> int: ...
    @property
    def njnt(self) -> int: ...
    @property
    def nkey(self) -> int: ...
    @property
    def nlight(self) -> int: ...
    @property
    def nmat(self) -> int: ...
    @property
    def nnumeric(self) -> int: ...
    @property
    def npair(self) -> int: ...
    @property
    def nq(self) -> int: ...
    @property
    def nsensor(self) -> int: ...
    @property
    def nsensordata(self) -> int: ...
    @property
    def nsite(self) -> int: ...
    @property
    def ntex(self) -> int: ...
    @property
    def nu(self) -> int: ...
    @property
    def nv(self) -> int: ...
    def numeric(self, name: str | Int, /) -> _MjModelNumericViews: ...
    opt: MjOption
    def pair(self, name: str | Int, /) -> _MjModelPairViews: ...
    qpos0: _Floats
    def sensor(self, name: str | Int, /) -> _MjModelSensorViews: ...
    sensor_adr: _Ints
    sensor_dim: _Ints
    def site(self, name: str | Int, /) -> _MjModelSiteViews: ...
    site_bodyid: _Ints
    site_pos: _Floats
    site_quat: _Floats
    stat: MjStatistic
    tex_adr: _Field[NDArray[np.int64], ArrayLike]
    tex_data: _Field[NDArray[np.uint8], ArrayLike]
    tex_height: _Ints
    tex_nchannel: _Ints
    tex_type: _Ints
    tex_width: _Ints
    text_adr: _Ints
    @property
    def text_data(self) -> bytes: ...
    text_size: _Ints
    vis: MjVisual

class MjData:
    def __init__(self, model: MjModel, /) -> None: ...
    act: _Floats
    def actuator(self, name: str | Int, /) -> _MjDataActuatorViews: ...
    actuator_force: _Floats
    def bind(self, specs: Any) -> Any: ...
    def body(self, name: str | Int, /) -> _MjDataBodyViews: ...
    def camera(self, name: str | Int, /) -> _MjDataCameraViews: ...
    cfrc_ext: _Floats
    @property
    def contact(self) -> _MjContactList: ...
    ctrl: _Floats
    efc_J: _Floats
    efc_pos: _Floats
    efc_type: _Ints
    energy: _Floats
    def geom(self, name: str | Int, /) -> _MjDataGeomViews: ...
    geom_xmat: _Floats
    geom_xpos: _Floats
    history: _Floats
    def joint(self, name: str | Int, /) -> _MjDataJointViews: ...
    @property
    def model(self) -> MjModel: ...
    nbuffer: _Int
    ncon: _Int
    ne: _Int
    qacc: _Floats
    qfrc_actuator: _Floats
    qfrc_applied: _Floats
    qfrc_bias: _Floats
    qfrc_damper: _Floats
    qfrc_inverse: _Floats
    qfrc_passive: _Floats
    qfrc_smooth: _Floats
    qpos: _Floats
    qvel: _Floats
    def sensor(self, name: str | Int, /) -> _MjDataSensorViews: ...
    sensordata: _Floats
    def site(self, name: str | Int, /) -> _MjDataSiteViews: ...
    site_xmat: _Floats
    subtree_com: _Floats
    time: _Float
    @property
    def warning(self) -> _MjWarningStatList: ...
    xanchor: _Floats
    xaxis: _Floats
    xfrc_applied: _Floats
    xmat: _Floats
    xpos: _Floats
    xquat: _Floats

class MjOption:
    disableactuator: _Int
    disableflags: _Int
    enableflags: _Int
    gravity: _Floats
    integrator: _Int
    iterations: _Int
    jacobian: _Int
    ls_iterations: _Int
    ls_tolerance: _Float
    solver: _Int
    timestep: _Float
    tolerance: _Float

class MjStatistic: ...

class MjVisual:
    global_: MjVisual.Global
    headlight: MjVisual.Headlight
    map: MjVisual.Map
    quality: MjVisual.Quality
    scale: MjVisual.Scale

class MjLogConfig:
    @staticmethod
    def get() -> MjLogConfig: ...
    logto_console: bool
    logto_file: bool
    def set(self) -> None: ...
    topics: _Int

class _MjContactList:
    dim: _Ints
    exclude: _Ints
    frame: _Floats
    friction: _Floats
    geom: _Ints
    mu: _Floats
    pos: _Floats
    solref: _Floats

class _MjWarningStatList:
    number: _Ints

class _MjDataActuatorViews:
    ctrl: _Floats
    force: _Floats
    @property
    def id(self) -> int: ...
    length: _Floats
    @property
    def name(self) -> str: ...
    velocity: _Floats

class _MjDataBodyViews:
    cfrc_ext: _Floats
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    subtree_com: _Floats
    xfrc_applied: _Floats
    xmat: _Floats
    xpos: _Floats
    xquat: _Floats

class _MjDataCameraViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xmat: _Floats
    xpos: _Floats

class _MjDataGeomViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xmat: _Floats
    xpos: _Floats
    xquat: _Floats

class _MjDataJointViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    qacc: _Floats
    qfrc_actuator: _Floats
    qfrc_applied: _Floats
    qfrc_bias: _Floats
    qfrc_passive: _Floats
    qfrc_smooth: _Floats
    qpos: _Floats
    qvel: _Floats
    xanchor: _Floats
    xaxis: _Floats

class _MjDataSensorViews:
    data: _Floats
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...

class _MjDataSiteViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    xmat: _Floats
    xpos: _Floats
    xquat: _Floats

class _MjModelActuatorViews:
    biasprm: _Floats
    biastype: _Ints
    ctrllimited: _Bools
    ctrlrange: _Floats
    forcelimited: _Bools
    forcerange: _Floats
    gainprm: _Floats
    gaintype: _Ints
    gear: _Floats
    group: _Ints
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    trnid: _Ints
    trntype: _Ints

class _MjModelBodyViews:
    dofadr: _Ints
    geomadr: _Ints
    @property
    def id(self) -> int: ...
    inertia: _Floats
    ipos: _Floats
    iquat: _Floats
    mass: _Floats
    @property
    def name(self) -> str: ...
    pos: _Floats
    simple: _Field[NDArray[np.uint8], ArrayLike]

class _MjModelCameraViews:
    bodyid: _Ints
    @property
    def id(self) -> int: ...
    mode: _Ints
    @property
    def name(self) -> str: ...
    pos: _Floats

class _MjModelExcludeViews:
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...

class _MjModelGeomViews:
    bodyid: _Ints
    conaffinity: _Ints
    contype: _Ints
    friction: _Floats
    gap: _Floats
    group: _Ints
    @property
    def id(self) -> int: ...
    margin: _Floats
    @property
    def name(self) -> str: ...
    pos: _Floats
    priority: _Ints
    size: _Floats
    solref: _Floats
    type: _Ints

class _MjModelJointViews:
    armature: _Floats
    axis: _Floats
    bodyid: _Ints
    damping: _Floats
    dofadr: _Ints
    frictionloss: _Floats
    group: _Ints
    @property
    def id(self) -> int: ...
    limited: _Bools
    margin: _Floats
    @property
    def name(self) -> str: ...
    pos: _Floats
    qpos0: _Floats
    qposadr: _Ints
    range: _Floats
    solref: _Floats
    stiffness: _Floats
    type: _Ints

class _MjModelKeyframeViews:
    act: _Floats
    ctrl: _Floats
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    qpos: _Floats
    qvel: _Floats
    time: _Floats

class _MjModelNumericViews:
    data: _Floats
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...

class _MjModelPairViews:
    dim: _Ints
    friction: _Floats
    gap: _Floats
    @property
    def id(self) -> int: ...
    margin: _Floats
    @property
    def name(self) -> str: ...
    solref: _Floats

class _MjModelSensorViews:
    dim: _Ints
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    noise: _Floats
    type: _Ints

class _MjModelSiteViews:
    bodyid: _Ints
    group: _Ints
    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    pos: _Floats
    size: _Floats
    type: _Ints
