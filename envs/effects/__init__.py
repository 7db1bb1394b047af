"""The effects that every verb knows, by their standard names.

    effect = make("link_mass", where="torso", how="set")
    plant = Plant(spec, [effect], fixed=load_effects("effects.yaml"))

`EFFECTS` maps the names of the vocabulary to classes; `register` adds one of the user's own.
"""

from envs.effects.appearance import CameraShift, CameraTurn, Colour, LightDirection, LightLevel
from envs.effects.backlash import Backlash
from envs.effects.base import Effect, Extra, Sizes
from envs.effects.bound import BoundEffect, CommandRule, Measurement, SubstepRule
from envs.effects.clock import ClockDrift
from envs.effects.cogging import Cogging
from envs.effects.command import CommandDelay, PacketLoss, ProfileAcceleration, ProfileVelocity
from envs.effects.contact import ContactStiffness, GroundFriction
from envs.effects.drive import ActuatorLag, IntegralAction, TorqueSpeedKnee
from envs.effects.eccentricity import EncoderEccentricity
from envs.effects.field import FieldEffect
from envs.effects.file import load_effects, write_effects
from envs.effects.friction import Armature, CoulombFriction, ViscousFriction
from envs.effects.friction_rules import AsymmetricFriction, LoadDependentFriction, StribeckFriction
from envs.effects.goal import Goal
from envs.effects.hysteresis import HystereticCompliance
from envs.effects.imu import GyroBias, GyroScale, ImuDelay, ImuMounting
from envs.effects.inertia import CenterOfMass, GravityTilt, LinkInertia, LinkMass, Payload
from envs.effects.length import LinkLength
from envs.effects.merge import merge_effects
from envs.effects.registry import EFFECTS, make, register
from envs.effects.sampling import ObservationDelay
from envs.effects.scale import RobotScale
from envs.effects.sensing import EncoderOffset, Quantization, SensorNoise, VelocityFilter
from envs.effects.servo import DeadZone, DerivativeGain, PositionGain, TorqueLimit
from envs.effects.strength import MotorStrength
from envs.effects.structure import JointCompliance
from envs.effects.supply import SupplySag, SupplyVoltage, ThermalDerating
from envs.effects.surface import Restitution, SurfaceFriction

for _effect in (
    *(CoulombFriction, ViscousFriction, StribeckFriction, LoadDependentFriction, Cogging, Armature),
    AsymmetricFriction,
    *(Backlash, JointCompliance, HystereticCompliance),
    *(PositionGain, DerivativeGain, MotorStrength, TorqueLimit, DeadZone),
    *(TorqueSpeedKnee, ActuatorLag, IntegralAction),
    *(SupplyVoltage, SupplySag, ThermalDerating),
    *(CommandDelay, PacketLoss, ProfileVelocity, ProfileAcceleration),
    *(ObservationDelay, EncoderOffset, EncoderEccentricity, ClockDrift),
    *(SensorNoise, Quantization, VelocityFilter),
    *(ImuMounting, ImuDelay, GyroBias, GyroScale),
    *(LinkMass, CenterOfMass, Payload, GravityTilt, GroundFriction, ContactStiffness),
    *(LinkInertia, LinkLength, SurfaceFriction, Restitution),
    *(Colour, LightLevel, LightDirection, CameraShift, CameraTurn),
    Goal,
):
    register(_effect)

__all__ = [
    "EFFECTS",
    "BoundEffect",
    "CommandRule",
    "Effect",
    "Extra",
    "FieldEffect",
    "Measurement",
    "RobotScale",
    "Sizes",
    "SubstepRule",
    "load_effects",
    "make",
    "merge_effects",
    "register",
    "write_effects",
]
