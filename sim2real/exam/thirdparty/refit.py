"""Whether something in the vocabulary does what a law outside it does.

    left = refits(made, robot, seed)                # {"viscous_friction": 4.2, ...} in floors

Each effect of the vocabulary is fitted alone, at the joint of the law (the one with the largest gap
where it has none), to the body that this joint moves, and to the whole robot, by the search of
`sim2real.exam.refit`, on a motion of its own that has all parts. What any of them leaves is what a
diagnosis with one cause could reach.
"""

import numpy as np

from envs.effects import EFFECTS as VOCABULARY
from envs.effects import Effect, Sizes, make
from envs.errors import EnvsError
from sim2real.exam.logs import difference
from sim2real.exam.refit import RIVAL_FLOORS, search, with_effect
from sim2real.exam.thirdparty.hidden import LAWS, known, units
from sim2real.exam.thirdparty.make import LOOK, Made
from sim2real.exam.thirdparty.robots import Robot, nominal, plan


def refits(made: Made, robot: Robot, seed: int) -> dict[str, float]:
    """Return the gap that each effect of the vocabulary leaves of a case's, in noise floors.

    It stops at the first one that leaves no more than twice the floor. The motion, and where fits
    look, follow from the seed.
    """
    rng, rig = np.random.default_rng([seed, 7]), made.bare
    ctrl = plan(robot, LOOK, rng)
    log = made.rig.drive(ctrl, seed)
    worst = rig.driven[int(np.argmax(difference(log, rig.drive(ctrl, seed))))]
    joint = made.truths[0]["joint"] or worst
    found: dict[str, float] = {}
    for name in known(rig):
        law = LAWS[name]
        sizes = Sizes(law.form, law.unit, law.low, law.high)
        unit = units(rig, joint)[law.unit]
        for effect in _effects(name, joint, rig.tree.mover(joint).body):
            enough = RIVAL_FLOORS * made.floor
            plant = with_effect(nominal(robot), effect)
            if plant is not None:
                best = search(plant, effect, sizes, unit, log, enough, rng)
                found[name] = min(best.left / made.floor, found.get(name, np.inf))
        if found.get(name, np.inf) <= RIVAL_FLOORS:
            break
    return found


def _effects(name: str, joint: str, body: str) -> list[Effect]:
    kind = VOCABULARY[name]
    where = {"robot": None, "body": body}.get(kind.place, joint)
    free = tuple(extra.name for extra in kind.extras if extra.typical is not None)
    extra = {"free": free} if free else {}
    try:
        return [make(name, where=where, side=side, **extra) for side in kind.sides or (None,)]
    except (EnvsError, TypeError):  # it asks for what this robot does not say
        return []
