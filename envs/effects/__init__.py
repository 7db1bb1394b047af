"""The effects that every verb knows, by their standard names.

    effect = make("link_mass", where="torso", how="set")

`EFFECTS` maps the names of the vocabulary to classes; `register` adds one of the user's own.
"""

from __future__ import annotations

from typing import Any

from envs.effects.base import (
    Bound,
    CommandRule,
    Effect,
    Extra,
    FieldEffect,
    Measurement,
    SubstepRule,
)
from envs.effects.command import CommandDelay, PacketLoss, ProfileAcceleration, ProfileVelocity
from envs.effects.contact import ContactStiffness, GroundFriction
from envs.effects.friction import (
    Armature,
    Cogging,
    CoulombFriction,
    LoadDependentFriction,
    StribeckFriction,
    ViscousFriction,
)
from envs.effects.inertia import CenterOfMass, GravityTilt, LinkMass, Payload
from envs.effects.sensing import (
    EncoderOffset,
    ObservationDelay,
    Quantization,
    SensorNoise,
    VelocityFilter,
)
from envs.effects.servo import DeadZone, DerivativeGain, MotorStrength, PositionGain, TorqueLimit
from envs.effects.structure import Backlash, JointCompliance
from envs.effects.supply import SupplySag, SupplyVoltage, ThermalDerating
from envs.errors import EffectError, did_you_mean

EFFECTS: dict[str, type[Effect]] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Add an effect class under its name; raises EffectError if another class has that name."""
    if EFFECTS.setdefault(effect.name, effect) is not effect:
        raise EffectError(
            f"effect {effect.name!r} is already {EFFECTS[effect.name].__name__};"
            " choose another name"
        )
    return effect


def make(name: str, **arguments: Any) -> Effect:
    """Return the effect of that standard name; raises EffectError with the nearest one if none."""
    if name not in EFFECTS:
        known = ", ".join(sorted(EFFECTS))
        raise EffectError(f"no effect {name!r}{did_you_mean(name, EFFECTS)}; there are: {known}")
    return EFFECTS[name](**arguments)


for _effect in (
    *(CoulombFriction, ViscousFriction, StribeckFriction, LoadDependentFriction, Cogging, Armature),
    *(Backlash, JointCompliance),
    *(PositionGain, DerivativeGain, MotorStrength, TorqueLimit, DeadZone),
    *(SupplyVoltage, SupplySag, ThermalDerating),
    *(CommandDelay, PacketLoss, ProfileVelocity, ProfileAcceleration),
    *(ObservationDelay, EncoderOffset, SensorNoise, Quantization, VelocityFilter),
    *(LinkMass, CenterOfMass, Payload, GravityTilt, GroundFriction, ContactStiffness),
):
    register(_effect)

__all__ = [
    "EFFECTS",
    "Bound",
    "CommandRule",
    "Effect",
    "Extra",
    "FieldEffect",
    "Measurement",
    "SubstepRule",
    "make",
    "register",
]
