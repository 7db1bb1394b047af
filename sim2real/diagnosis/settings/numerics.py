"""Settings of `diagnosis/attribution`: what is the simulator's own doing."""

from __future__ import annotations

from dataclasses import dataclass

from sim2real.diagnosis.settings.base import COST, DEVELOPED, JUDGED, setting


@dataclass(frozen=True)
class Numerics:
    """When a gap or a cause is the simulator's own doing."""

    piece_s: float = setting(5.0, "s", "length of a replayed piece", COST)
    pieces: int = setting(4, "1", "pieces replayed", COST)
    change: float = setting(0.1, "1", "change, of the gap, that is one", DEVELOPED)
    change_min: float = setting(0.005, "1", "change, of the motion, that matters", DEVELOPED)
    gain_left: float = setting(
        0.25, "1", "share of an effect's gain that must stay for it to be physics", DEVELOPED
    )
    armature: float = setting(
        5e-4,
        "kg·m²",
        "armature of joints without any",
        "reference: below that of the smallest servo (XL-320, 1.1e-3)",
    )
    motion_min: float = setting(0.03, "rad", "a joint that moves less counts as this", JUDGED)
    error_max: float = setting(5.0, "1", "larger errors count as this, of the motion", JUDGED)
    tolerance: float = setting(1e-12, "1", "the tighter solver's tolerance", JUDGED)
    line_tolerance: float = setting(1e-6, "1", "the same of its line search", JUDGED)
    iterations: int = setting(4, "1", "the tighter solver's iterations, of the model's", JUDGED)
    closed_min: float = setting(
        0.5,
        "1",
        "share of the gap from which an explanation of a part is looked at again in shorter steps",
        "computing time: right causes of the opened cases close 0.74 and more as given, that of "
        "the tests' pendulum 0.71",
    )
    finer: int = setting(
        4,
        "1",
        "times as many time steps there",
        "measured: the right causes of three opened cases of another engine (176, 184, 232) close "
        "0.96, 0.97 and 0.94 there, and 0.95, 0.90 and 0.94 in half of the step",
    )
    bends: tuple[float, ...] = setting(
        (1e-3, 3e-4),
        "rad",
        "by how much dry friction gives way there before it slips, in the order tried",
        "judgement: a geared servo's order of magnitude, 0.5 mrad in the emulator and 1 mrad in "
        "the robots of other engines",
    )
    ratio: float = setting(
        0.5,
        "1",
        "critical damping that it has until then, as a share",
        "reference: Canudas de Wit et al. 1995, table I (1e5 N/m and sqrt(1e5) N·s/m, a unit mass)",
    )
    rounds: int = setting(1, "1", "steps of the fit there, from the values found", COST)
    contenders: int = setting(
        2, "1", "nearest contenders for each cause's place that are looked at there, too", COST
    )
    contender_rounds: int = setting(
        3,
        "1",
        "steps of their fit, which shortcuts may have kept farther from its best",
        "measured: the true spring of a robot of another engine (case_005 of seed 49, opened) "
        "explains its log after three steps, and not after one (docs/thirdparty.md)",
    )
