"""A person beside an emulated robot in virtual time, who answers what the verbs ask."""

from collections.abc import Callable, Iterator, Mapping

from hardware.emulator.hand import Hand
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot

STEP = 0.02  # s
PLACES = {"one end": 0, "the other end": 1, "to its zero": 2, "angle grows": 3}


class Person:
    """Connects servos and moves joints as they are asked for, and says yes.

    Args:
        world: the robot.
        port: through which time goes on.
        places: of each joint, one end, the other, the zero, and a little up [rad].
    """

    def __init__(
        self, world: EmulatedRobot, port: LoopbackPort, places: Mapping[str, list[float]]
    ) -> None:
        self.world, self._clock, self.places = world, port.clock, places
        self.hand, self.asked = Hand(world), []
        self.ends: BaseException | None = None  # what an answer raises
        self.after = 0  # answers before that

    def __call__(self, prompt: str, meanwhile: Callable[[], object] | None = None) -> str:
        """Do what is asked."""
        self.asked.append(prompt)
        if self.ends is not None and len(self.asked) > self.after:
            raise self.ends
        if "write these" in prompt:
            return "y"
        for line in self.lines(prompt):
            if self.hand.obey(line) is None:
                while self.hand.step() is None:
                    self._clock.sleep_until(self._clock.now() + STEP)
                    self.world.advance(self._clock.now())
                    if meanwhile is not None:
                        meanwhile()
        return ""

    def lines(self, prompt: str) -> Iterator[str]:
        """Yield what the hand has to do for a question."""
        if "connect all" in prompt:
            yield "connect all"
        elif "connect" in prompt:
            name = next(n for n in self.places if f" {n} " in prompt or f"({n})" in prompt)
            yield from ("unplug all", f"connect {name}")
        else:
            name = prompt[prompt.rindex("move ") :].split()[1]
            place = next((i for words, i in PLACES.items() if words in prompt), None)
            here = float(self.world.mechanics.angle[self.world.robot.names.index(name)])
            yield f"move {name} {here + 0.2 if place is None else self.places[name][place]}"


def places_of(low: float, high: float, zero: float = 0.0, up: float = 0.1) -> list[float]:
    """Return the places of a joint whose angles grow by `up`; see `Person`."""
    return [low, high, zero, zero + up]
