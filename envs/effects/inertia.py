"""Effects on what a body weighs."""

from __future__ import annotations

from typing import ClassVar

from envs.effects.base import FieldEffect
from envs.params import How

LIGHTEST = 1e-3  # kg: below this the engine's constants become ill conditioned


class LinkMass(FieldEffect):
    """The mass of a body, at its centre of mass; its inertia tensor stays."""

    name = "link_mass"
    place = "body"
    unit = "kg"
    hows: ClassVar[tuple[How, ...]] = ("add", "set", "scale")
    field = "body_mass"
    minimum = LIGHTEST
    constants = True
    looks_like = "static sag and lag under load that grow with gravity's lever arm"
    source = "MuJoCo XML reference, body/inertial/mass"
    experiment = "hold several poses with the link horizontal, then swing it slowly"
