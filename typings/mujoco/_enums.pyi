"""Named numbers: those that this project names."""

from typing import SupportsIndex

class _Enum:
    @property
    def name(self) -> str: ...
    @property
    def value(self) -> int: ...
    def __init__(self, value: SupportsIndex) -> None: ...
    def __int__(self) -> int: ...
    def __index__(self) -> int: ...
    def __and__(self, other: SupportsIndex) -> int: ...
    def __or__(self, other: SupportsIndex) -> int: ...
    def __rand__(self, other: SupportsIndex) -> int: ...
    def __ror__(self, other: SupportsIndex) -> int: ...

class mjtActuator(_Enum): ...

class mjtBias(_Enum):
    mjBIAS_NONE: mjtBias
    mjBIAS_AFFINE: mjtBias

class mjtCamLight(_Enum): ...

class mjtCamera(_Enum):
    mjCAMERA_FIXED: mjtCamera

class mjtCatBit(_Enum):
    mjCAT_ALL: mjtCatBit

class mjtConstraint(_Enum):
    mjCNSTR_EQUALITY: mjtConstraint

class mjtEnableBit(_Enum):
    mjENBL_SLEEP: mjtEnableBit
    mjENBL_IPC: mjtEnableBit

class mjtDisableBit(_Enum):
    mjDSBL_CONTACT: mjtDisableBit
    mjDSBL_ACTUATION: mjtDisableBit
    mjDSBL_ISLAND: mjtDisableBit

class mjtEq(_Enum):
    mjEQ_JOINT: mjtEq
    mjEQ_TENDON: mjtEq

class mjtFontScale(_Enum):
    mjFONTSCALE_100: mjtFontScale

class mjtFramebuffer(_Enum):
    mjFB_OFFSCREEN: mjtFramebuffer

class mjtDyn(_Enum):
    mjDYN_NONE: mjtDyn
    mjDYN_INTEGRATOR: mjtDyn
    mjDYN_FILTER: mjtDyn
    mjDYN_FILTEREXACT: mjtDyn

class mjtGain(_Enum):
    mjGAIN_FIXED: mjtGain
    mjGAIN_SO3: mjtGain
    mjGAIN_PID: mjtGain

class mjtGeom(_Enum):
    mjGEOM_PLANE: mjtGeom
    mjGEOM_HFIELD: mjtGeom
    mjGEOM_SPHERE: mjtGeom
    mjGEOM_CAPSULE: mjtGeom
    mjGEOM_ELLIPSOID: mjtGeom
    mjGEOM_CYLINDER: mjtGeom
    mjGEOM_BOX: mjtGeom
    mjGEOM_MESH: mjtGeom

class mjtInertiaFromGeom(_Enum):
    mjINERTIAFROMGEOM_TRUE: mjtInertiaFromGeom
    mjINERTIAFROMGEOM_AUTO: mjtInertiaFromGeom

class mjtIntegrator(_Enum):
    mjINT_EULER: mjtIntegrator
    mjINT_RK4: mjtIntegrator
    mjINT_IMPLICITFAST: mjtIntegrator

class mjtJacobian(_Enum):
    mjJAC_DENSE: mjtJacobian

class mjtJoint(_Enum):
    mjJNT_FREE: mjtJoint
    mjJNT_BALL: mjtJoint
    mjJNT_SLIDE: mjtJoint
    mjJNT_HINGE: mjtJoint

class mjtLightType(_Enum): ...

class mjtLimited(_Enum):
    mjLIMITED_FALSE: mjtLimited
    mjLIMITED_TRUE: mjtLimited

class mjtMark(_Enum): ...
class mjtMeshInertia(_Enum): ...

class mjtObj(_Enum):
    mjOBJ_BODY: mjtObj
    mjOBJ_JOINT: mjtObj
    mjOBJ_SITE: mjtObj
    mjOBJ_ACTUATOR: mjtObj
    mjOBJ_SENSOR: mjtObj
    mjOBJ_TEXT: mjtObj

class mjtProjection(_Enum):
    mjPROJ_PERSPECTIVE: mjtProjection

class mjtOrientation(_Enum):
    mjORIENTATION_QUAT: mjtOrientation

class mjtRndFlag(_Enum):
    mjRND_SHADOW: mjtRndFlag
    mjRND_REFLECTION: mjtRndFlag
    mjRND_SKYBOX: mjtRndFlag
    mjRND_HAZE: mjtRndFlag

class mjtSensor(_Enum):
    mjSENS_ACCELEROMETER: mjtSensor
    mjSENS_GYRO: mjtSensor
    mjSENS_JOINTPOS: mjtSensor
    mjSENS_FRAMEQUAT: mjtSensor

class mjtSleepPolicy(_Enum): ...

class mjtSolver(_Enum):
    mjSOL_CG: mjtSolver
    mjSOL_NEWTON: mjtSolver

class mjtStage(_Enum):
    mjSTAGE_NONE: mjtStage

class mjtTexture(_Enum):
    mjTEXTURE_2D: mjtTexture

class mjtTextureRole(_Enum):
    mjTEXROLE_RGB: mjtTextureRole

class mjtTrn(_Enum):
    mjTRN_JOINT: mjtTrn
    mjTRN_JOINTINPARENT: mjtTrn
