"""Models before they are compiled."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mujoco._enums import (
    mjtActuator,
    mjtBias,
    mjtCamLight,
    mjtEq,
    mjtGain,
    mjtGeom,
    mjtInertiaFromGeom,
    mjtJoint,
    mjtLightType,
    mjtLimited,
    mjtMark,
    mjtMeshInertia,
    mjtOrientation,
    mjtSensor,
    mjtSleepPolicy,
    mjtTexture,
    mjtTrn,
)
from mujoco._fields import (
    ArrayLike,
    Float,
    Int,
    _Field,
    _Float,
    _Floats,
    _Int,
    _Ints,
    _Singles,
)
from mujoco._structs import MjModel, MjOption, MjStatistic

_Vector = _Field[Sequence[float], Iterable[Float]]

class _Element:
    name: str
    @property
    def id(self) -> int: ...

class MjSpec:
    def actuator(self, arg0: str, /) -> MjsActuator: ...
    @property
    def actuators(self) -> list[MjsActuator]: ...
    def add_actuator(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        type: Int | None = ...,
        trntype: Int | None = ...,
        gear: Iterable[Float] | None = ...,
        target: str | None = ...,
        damping: Float | Iterable[Float] | None = ...,
        armature: Float | None = ...,
        group: Int | None = ...,
        delay: Float | None = ...,
    ) -> MjsActuator: ...
    def add_equality(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        type: Int | None = ...,
        data: Iterable[Float] | None = ...,
        active: Int | None = ...,
        name1: str | None = ...,
        name2: str | None = ...,
    ) -> MjsEquality: ...
    def add_key(
        self,
        *,
        name: str | None = ...,
        time: Float | None = ...,
        qpos: Iterable[Float] | None = ...,
        qvel: Iterable[Float] | None = ...,
        ctrl: Iterable[Float] | None = ...,
    ) -> MjsKey: ...
    def add_numeric(
        self, *, name: str | None = ..., data: Iterable[Float] | None = ..., size: Int | None = ...
    ) -> MjsNumeric: ...
    def add_pair(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        geomname1: str | None = ...,
        geomname2: str | None = ...,
        solref: Iterable[Float] | None = ...,
        solimp: Iterable[Float] | None = ...,
        gap: Float | None = ...,
        friction: Iterable[Float] | None = ...,
    ) -> MjsPair: ...
    def add_sensor(
        self,
        *,
        name: str | None = ...,
        type: Int | None = ...,
        objtype: Int | None = ...,
        objname: str | None = ...,
        dim: Int | None = ...,
        cutoff: Float | None = ...,
        noise: Float | None = ...,
        delay: Float | None = ...,
    ) -> MjsSensor: ...
    def add_tendon(
        self, *, default: MjsDefault | None = ..., name: str | None = ...
    ) -> MjsTendon: ...
    def add_text(
        self, name: str | None = ..., data: str | None = ..., info: str | None = ...
    ) -> MjsText: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    def body(self, arg0: str, /) -> MjsBody: ...
    def camera(self, arg0: str, /) -> MjsCamera: ...
    comment: str
    def compile(self, vfs: Any = ...) -> MjModel: ...
    compiler: MjsCompiler
    def copy(self) -> MjSpec: ...
    @property
    def default(self) -> MjsDefault: ...
    def delete(self, element: _Element, /) -> None: ...
    @property
    def equalities(self) -> list[MjsEquality]: ...
    def exclude(self, arg0: str, /) -> MjsExclude: ...
    @property
    def excludes(self) -> list[MjsExclude]: ...
    def frame(self, arg0: str, /) -> MjsFrame: ...
    @property
    def frames(self) -> list[MjsFrame]: ...
    @staticmethod
    def from_file(
        filename: str,
        include: Mapping[str, bytes] | None = ...,
        assets: dict[str, bytes] | None = ...,
        vfs: Any = ...,
    ) -> MjSpec: ...
    @staticmethod
    def from_string(
        xml: str,
        include: Mapping[str, bytes] | None = ...,
        assets: dict[str, bytes] | None = ...,
        vfs: Any = ...,
    ) -> MjSpec: ...
    def geom(self, arg0: str, /) -> MjsGeom: ...
    @property
    def geoms(self) -> list[MjsGeom]: ...
    @property
    def hfields(self) -> list[MjsHField]: ...
    def joint(self, arg0: str, /) -> MjsJoint: ...
    @property
    def joints(self) -> list[MjsJoint]: ...
    def key(self, arg0: str, /) -> MjsKey: ...
    @property
    def keys(self) -> list[MjsKey]: ...
    @property
    def materials(self) -> list[MjsMaterial]: ...
    memory: _Int
    meshdir: str
    @property
    def meshes(self) -> list[MjsMesh]: ...
    modelfiledir: str
    modelname: str
    nkey: _Int
    @property
    def numerics(self) -> list[MjsNumeric]: ...
    option: MjOption
    def pair(self, arg0: str, /) -> MjsPair: ...
    @property
    def pairs(self) -> list[MjsPair]: ...
    @property
    def parent(self) -> MjSpec: ...
    def sensor(self, arg0: str, /) -> MjsSensor: ...
    @property
    def sensors(self) -> list[MjsSensor]: ...
    def site(self, arg0: str, /) -> MjsSite: ...
    @property
    def sites(self) -> list[MjsSite]: ...
    @property
    def skins(self) -> list[MjsSkin]: ...
    stat: MjStatistic
    @property
    def tendons(self) -> list[MjsTendon]: ...
    def text(self, arg0: str, /) -> MjsText: ...
    @property
    def texts(self) -> list[MjsText]: ...
    texturedir: str
    @property
    def textures(self) -> list[MjsTexture]: ...
    def to_xml(self) -> str: ...
    @property
    def worldbody(self) -> MjsBody: ...

class MjsActuator(_Element):
    armature: _Float
    biasprm: _Floats
    biastype: _Field[mjtBias, Int]
    ctrllimited: _Field[mjtLimited, Int]
    ctrlrange: _Floats
    damping: _Floats
    delay: _Float
    forcelimited: _Field[mjtLimited, Int]
    forcerange: _Floats
    gainprm: _Floats
    gaintype: _Field[mjtGain, Int]
    gear: _Floats
    group: _Int
    inheritrange: _Float
    interp: _Int
    nsample: _Int
    def set_to_dcmotor(
        self, *, motorconst: ArrayLike, resistance: Float, nominal: ArrayLike = ...
    ) -> None: ...
    def set_to_motor(self) -> None: ...
    def set_to_position(
        self,
        kp: Float,
        kv: Float = ...,
        dampratio: Float = ...,
        timeconst: Float = ...,
        inheritrange: bool = ...,
    ) -> None: ...
    target: str
    trntype: _Field[mjtTrn, Int]
    type: _Field[mjtActuator, Int]

class MjsBody(_Element):
    def add_body(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        pos: Iterable[Float] | None = ...,
        mass: Float | None = ...,
        inertia: Iterable[Float] | None = ...,
    ) -> MjsBody: ...
    def add_freejoint(self, **kwargs: Any) -> MjsJoint: ...
    def add_geom(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        type: Int | None = ...,
        pos: Iterable[Float] | None = ...,
        fromto: Iterable[Float] | None = ...,
        size: Iterable[Float] | None = ...,
        contype: Int | None = ...,
        conaffinity: Int | None = ...,
        friction: Iterable[Float] | None = ...,
        solref: Iterable[Float] | None = ...,
        solimp: Iterable[Float] | None = ...,
        gap: Float | None = ...,
        mass: Float | None = ...,
        group: Int | None = ...,
    ) -> MjsGeom: ...
    def add_joint(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        type: Int | None = ...,
        pos: Iterable[Float] | None = ...,
        axis: Iterable[Float] | None = ...,
        stiffness: Float | Iterable[Float] | None = ...,
        range: Iterable[Float] | None = ...,
        armature: Float | None = ...,
        damping: Float | Iterable[Float] | None = ...,
        group: Int | None = ...,
    ) -> MjsJoint: ...
    def add_site(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        pos: Iterable[Float] | None = ...,
        size: Iterable[Float] | None = ...,
        type: Int | None = ...,
        group: Int | None = ...,
    ) -> MjsSite: ...
    @property
    def bodies(self) -> list[MjsBody]: ...
    gravcomp: _Float
    explicitinertial: bool
    def first_geom(self) -> MjsGeom: ...
    @property
    def frame(self) -> MjsFrame: ...
    @property
    def frames(self) -> list[MjsFrame]: ...
    fullinertia: _Floats
    @property
    def geoms(self) -> list[MjsGeom]: ...
    inertia: _Floats
    ipos: _Floats
    iquat: _Floats
    @property
    def joints(self) -> list[MjsJoint]: ...
    mass: _Float
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    simple: _Int
    @property
    def sites(self) -> list[MjsSite]: ...
    sleep: _Field[mjtSleepPolicy, Int]

class MjsCamera(_Element):
    @property
    def frame(self) -> MjsFrame: ...
    mode: _Field[mjtCamLight, Int]
    output: _Int
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    resolution: _Ints

class MjsCompiler:
    balanceinertia: bool
    boundinertia: _Float
    boundmass: _Float
    degree: bool
    inertiafromgeom: _Field[mjtInertiaFromGeom, Int]
    meshdir: str
    settotalmass: _Float
    texturedir: str

class MjsDefault(_Element):
    actuator: MjsActuator
    camera: MjsCamera
    geom: MjsGeom
    joint: MjsJoint
    pair: MjsPair
    site: MjsSite

class MjsEquality(_Element):
    active: bool
    data: _Floats
    solref: _Floats
    type: _Field[mjtEq, Int]

class MjsExclude(_Element): ...

class MjsFrame(_Element):
    def add_body(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        pos: Iterable[Float] | None = ...,
        mass: Float | None = ...,
        inertia: Iterable[Float] | None = ...,
    ) -> MjsBody: ...
    def add_geom(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        type: Int | None = ...,
        pos: Iterable[Float] | None = ...,
        size: Iterable[Float] | None = ...,
        contype: Int | None = ...,
        conaffinity: Int | None = ...,
        friction: Iterable[Float] | None = ...,
        solref: Iterable[Float] | None = ...,
        solimp: Iterable[Float] | None = ...,
        gap: Float | None = ...,
        mass: Float | None = ...,
        group: Int | None = ...,
    ) -> MjsGeom: ...
    def add_joint(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        type: Int | None = ...,
        pos: Iterable[Float] | None = ...,
        axis: Iterable[Float] | None = ...,
        stiffness: Float | Iterable[Float] | None = ...,
        range: Iterable[Float] | None = ...,
        armature: Float | None = ...,
        damping: Float | Iterable[Float] | None = ...,
        group: Int | None = ...,
    ) -> MjsJoint: ...
    def add_site(
        self,
        *,
        default: MjsDefault | None = ...,
        name: str | None = ...,
        pos: Iterable[Float] | None = ...,
        size: Iterable[Float] | None = ...,
        type: Int | None = ...,
        group: Int | None = ...,
    ) -> MjsSite: ...
    @property
    def frame(self) -> MjsFrame: ...
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    scale: _Floats

class MjsGeom(_Element):
    @property
    def alt(self) -> MjsOrientation: ...
    conaffinity: _Int
    contype: _Int
    density: _Float
    @property
    def frame(self) -> MjsFrame: ...
    friction: _Floats
    gap: _Float
    group: _Int
    margin: _Float
    mass: _Float
    meshname: str
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    priority: _Int
    quat: _Floats
    size: _Floats
    solref: _Floats
    type: _Field[mjtGeom, Int]

class MjsOrientation:
    type: _Field[mjtOrientation, Int]

class MjsJoint(_Element):
    actfrclimited: _Field[mjtLimited, Int]
    armature: _Float
    axis: _Floats
    damping: _Floats
    @property
    def frame(self) -> MjsFrame: ...
    frictionloss: _Float
    group: _Int
    limited: _Field[mjtLimited, Int]
    margin: _Float
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    range: _Floats
    ref: _Float
    solimp_friction: _Floats
    solimp_limit: _Floats
    solref_friction: _Floats
    solref_limit: _Floats
    springref: _Float
    stiffness: _Floats
    type: _Field[mjtJoint, Int]

class MjsKey(_Element):
    act: _Vector
    ctrl: _Vector
    qpos: _Vector
    qvel: _Vector
    time: _Float

class MjsLight(_Element):
    active: bool
    ambient: _Singles
    diffuse: _Singles
    @property
    def frame(self) -> MjsFrame: ...
    mode: _Field[mjtCamLight, Int]
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    range: _Float
    softness: _Float
    type: _Field[mjtLightType, Int]

class MjsMaterial(_Element):
    textures: Sequence[str]

class MjsMesh(_Element):
    file: str
    inertia: _Field[mjtMeshInertia, Int]
    scale: _Floats

class MjsNumeric(_Element): ...

class MjsPair(_Element):
    friction: _Floats
    gap: _Float
    margin: _Float
    solref: _Floats

class MjsSensor(_Element):
    delay: _Float
    dim: _Int
    interp: _Int
    interval: _Floats
    noise: _Float
    nsample: _Int
    type: _Field[mjtSensor, Int]

class MjsSite(_Element):
    @property
    def frame(self) -> MjsFrame: ...
    group: _Int
    @property
    def parent(self) -> MjsBody: ...
    pos: _Floats
    size: _Floats
    type: _Field[mjtGeom, Int]

class MjsTendon(_Element):
    actfrclimited: _Field[mjtLimited, Int]
    armature: _Float
    damping: _Floats
    def default(self) -> MjsDefault: ...
    frictionloss: _Float
    group: _Int
    limited: _Field[mjtLimited, Int]
    margin: _Float
    @property
    def path(self) -> Any: ...
    range: _Floats
    solimp_friction: _Floats
    solimp_limit: _Floats
    solref_friction: _Floats
    solref_limit: _Floats
    stiffness: _Floats
    width: _Float
    def wrap_joint(self, arg0: str, arg1: Float, /) -> Any: ...

class MjsText(_Element):
    data: str

class MjsTexture(_Element):
    data: bytes
    file: str
    height: _Int
    mark: _Field[mjtMark, Int]
    random: _Float
    type: _Field[mjtTexture, Int]
    width: _Int

class MjsHField(_Element):
    file: str

class MjsSkin(_Element):
    file: str
