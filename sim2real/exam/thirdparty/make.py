"""Making one case: places and sizes, so that the gap is a drawn number of floors.

    found = make("dirty", ROBOTS["arm3"], ("backlash",), seed=3, engine="drake", seconds=24)
    found.truths, found.gap / found.floor, found.rig

A gap is the RMS difference between the log of a robot and what the robot without anything hidden
does under the same commands; the floor is what it differs from itself under other noise, or one
count of the encoder. Sizes are such that the gap of an effect is log-uniform between 3 and 30
floors; under a dirty background it is at least twice the background's.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hardware.errors import HardwareError
from sim2real.exam.logs import difference, overall
from sim2real.exam.thirdparty.engines import EngineName
from sim2real.exam.thirdparty.hidden import LAWS, Truth, put
from sim2real.exam.thirdparty.kinds import Kind
from sim2real.exam.thirdparty.outside import OUTSIDE
from sim2real.exam.thirdparty.rig import Rig
from sim2real.exam.thirdparty.robots import Robot, make_rig, plan

LEAST, MOST = 3.0, 30.0  # floors: the gap of an effect
OFF = (2.0, 5.0)  # floors: the gap of a nominal model that is a little off
DIRT = 0.05  # share by which the numbers of a dirty background are off, at most
BEYOND = 2.0  # times the background's gap: the least of a dominant effect
CLOSE = 1.25  # a gap this near to the wanted one, as a factor, will do
TRIALS = 7
LOOK = 8.0  # s of motion on which sizes are sought
WILD = 1.5  # rad: a robot that errs more has lost its way


@dataclass(frozen=True)
class Made:
    """A robot that hides something."""

    rig: Rig  # the robot
    bare: Rig  # the same with nothing hidden
    truths: tuple[Truth, ...]  # what is hidden, each with its own `gap` [rad]
    gap: float  # of all of it [rad]
    floor: float  # [rad]
    background: float = 0.0  # gap of what is a little off everywhere [rad]


class Bench:
    """Drives robots along one motion and measures their gaps."""

    def __init__(self, robot: Robot, seed: int, engine: EngineName) -> None:
        self._seed = seed
        self.rig = make_rig(robot, engine)
        self._ctrl = plan(robot, LOOK, np.random.default_rng([seed, 5]))
        self._bare = self.rig.drive(self._ctrl, seed)
        again = self.rig.drive(self._ctrl, seed + 1)
        count = 2 * np.pi / robot.counts
        self.floor = max(overall(difference(self._bare, again)), count)

    def gap(self, rig: Rig) -> float | None:
        """Return a robot's gap [rad]; None if it cannot run so."""
        try:
            log = rig.drive(self._ctrl, self._seed)
        except (HardwareError, RuntimeError, OverflowError, ValueError):
            return None  # it flew apart
        gap = overall(difference(log, self._bare))
        return gap if gap < WILD else None

    def size(
        self,
        change: Callable[[float], Rig],
        low: float,
        high: float,
        wanted: float,
        least: float,
    ) -> tuple[float, float] | None:
        """Return the size whose gap is nearest to a wanted one, and the gap [rad].

        None where none in [low, high] reaches `least` [rad]. What hides a size is made by `change`.
        """
        ends, best = [math.log(low), math.log(high)], None
        at = 0.5 * sum(ends)
        for trial in range(TRIALS):
            gap = self.gap(change(math.exp(at)))
            far = math.inf if gap is None else abs(math.log(max(gap, 1e-9) / wanted))
            if gap is not None and gap >= least and (best is None or far < best[2]):
                best = (math.exp(at), gap, far)
            if far < math.log(CLOSE):
                break
            above = gap is None or gap > wanted
            ends[int(above)] = at
            top = trial == 0 and not above  # does the largest reach it at all?
            at = ends[1] if top else 0.5 * sum(ends)
            if top:
                ends[1] += 1e-3
        return best[:2] if best else None


def make(
    kind: Kind, robot: Robot, effects: tuple[str, ...], seed: int, engine: EngineName
) -> Made | None:
    """Find places and sizes of effects or outside laws; None if the robot cannot show them."""
    rng = np.random.default_rng([seed, 1])
    bench = Bench(robot, seed, engine)
    floors = float(np.exp(rng.uniform(math.log(LEAST), math.log(MOST))))
    if kind == "off_nominal":
        return _off(bench, rng)
    if kind == "outside":
        return _outside(bench, effects[0], floors, rng)
    rig, background = bench.rig, 0.0
    if kind == "dirty":
        rig = _dirty(bench.rig, DIRT, rng)
        gap = bench.gap(rig)
        if gap is None:
            return None
        background = gap
        floors = max(floors, BEYOND * background / bench.floor * CLOSE)
    return _inside(bench, kind, effects, floors, (rig, background), rng)


def _inside(
    bench: Bench,
    kind: Kind,
    effects: tuple[str, ...],
    floors: float,
    dirty: tuple[Rig, float],
    rng: np.random.Generator,
) -> Made | None:
    truths: list[Truth] = []
    rig, background = dirty
    for effect in effects:
        taken = [truth["joint"] for truth in truths]
        truth = _truth(bench, kind, effect, taken, floors, background, rng)
        if truth is None:
            return None
        truths.append(truth)
        floors = float(np.exp(rng.uniform(math.log(LEAST), math.log(MOST))))
    for truth in truths:
        rig = put(rig, truth)
    gap = bench.gap(rig)
    if gap is None:
        return None
    return Made(rig, bench.rig, tuple(truths), gap, bench.floor, background)


def _truth(
    bench: Bench,
    kind: Kind,
    effect: str,
    taken: list[Any],
    floors: float,
    background: float,
    rng: np.random.Generator,
) -> Truth | None:
    """Find a place and a size for one effect."""
    law, rig = LAWS[effect], bench.rig
    spots: list[str | None] = [None]
    if law.place != "robot" and kind != "robot_wide":
        spots = [str(name) for name in rng.permutation(list(rig.driven)) if name not in taken]
        spots = spots or [str(rng.choice(list(rig.driven)))]  # a robot of one joint
    for spot in spots:
        draw = law.draw(rig, spot, rng)
        more: Truth = {"effect": effect}
        if kind == "robot_wide":
            more["shared"] = True
        if kind == "encoders":
            more["encoder"] = str(rng.choice(["motor", "link"]))

        def truth(size: float, draw: Any = draw, more: Truth = more) -> Truth:
            entry = {**more, **draw(size)}
            if more.get("encoder") is not None:  # never the firmware's own
                entry["side"] = "link" if more["encoder"] == "motor" else "motor"
            return entry

        def change(size: float, truth: Any = truth) -> Rig:
            return put(rig, truth(size))

        least = max(LEAST * bench.floor, BEYOND * background)
        found = bench.size(change, law.low, law.high, floors * bench.floor, least)
        if found is not None:
            return {**truth(found[0]), "gap": found[1]}
    return None


def _outside(bench: Bench, name: str, floors: float, rng: np.random.Generator) -> Made | None:
    law, seed = OUTSIDE[name], int(rng.integers(2**31))
    for joint in rng.permutation(list(bench.rig.driven)).tolist():

        def change(size: float, joint: str = joint) -> Rig:
            return law.put(bench.rig, joint, size, np.random.default_rng(seed))

        least = LEAST * bench.floor
        found = bench.size(change, law.low, law.high, floors * bench.floor, least)
        if found is None:
            continue
        size, gap = found
        place = joint if law.place else None
        truth = {"effect": name, "where": place, "joint": place, "side": None}
        truth |= {"value": size, "extra": {}, "gap": gap}
        return Made(change(size), bench.rig, (truth,), gap, bench.floor)
    return None


def _off(bench: Bench, rng: np.random.Generator) -> Made | None:
    wanted = float(np.exp(rng.uniform(*np.log(OFF)))) * bench.floor
    seed = int(rng.integers(2**31))

    def change(share: float) -> Rig:
        return _dirty(bench.rig, share, np.random.default_rng(seed))

    found = bench.size(change, 0.002, 0.3, wanted, OFF[0] * bench.floor)
    if found is None or found[1] > OFF[1] * bench.floor:
        return None
    share, gap = found
    return Made(change(share), bench.rig, (), gap, bench.floor, gap)


def _dirty(rig: Rig, share: float, rng: np.random.Generator) -> Rig:
    """Return a robot whose every number that a model has is off by a factor within 1 ± share."""
    links = {link.body: 1 + share * rng.uniform(-1, 1, 3) for link in rig.tree.links}
    joints = {name: 1 + share * rng.uniform(-1, 1, 6) for name in rig.driven}

    tree = rig.tree
    for body, (mass, inertia, centre) in links.items():
        link = tree.link(body)
        numbers = {"inertia": link.inertia * inertia, "centre": link.centre * centre}
        tree = tree.change(body, mass=link.mass * mass, **numbers)
    rig = replace(rig, tree=tree)
    for name, (dry, wet, rotor, kp, kd, braking) in joints.items():
        joint = rig.joints[name]
        servo, rubs = joint.servo, joint.friction
        assert servo is not None
        rig = rig.friction(name, coulomb=rubs.coulomb * dry, viscous=rubs.viscous * wet)
        rig = rig.change(name, armature=joint.armature * rotor)
        rig = rig.servo(name, kp=servo.kp * kp, kd=servo.kd * kd)
        strength = servo.strength * kp if servo.torque else servo.strength
        rig = rig.servo(name, braking=servo.braking * braking, strength=strength)
    return rig
