"""The person next to a real robot, who consents to each motion and may measure its distance.

    operator = Operator()
    operator.consents("bench1 runs three episodes. Is the space around it clear?")
    operator.distance("episode 2")              # m

Without a terminal the answer is no.
"""

import math
from collections.abc import Callable

from sim2real.runs.errors import Sim2RealError

YES = ("y", "yes")


class DeclinedError(Exception):
    """The operator did not want the robot to move."""


class Operator:
    """Answers questions.

    Args:
        ask: shows a question and returns the answer; None asks at the terminal.
    """

    def __init__(self, ask: Callable[[str], str] | None = None) -> None:
        self._ask = ask or input

    def consents(self, question: str) -> None:
        """Ask before a robot moves.

        Raises:
            DeclinedError: any answer but yes.
        """
        try:
            answer = self._ask(f"{question} Go on? [y/N] ")
        except EOFError:
            answer = ""
        if answer.strip().lower() not in YES:
            raise DeclinedError

    def distance(self, what: str) -> float:
        """Ask how far the robot went, until the answer is a number; return it [m].

        Raises:
            Sim2RealError: there is no terminal to ask at.
        """
        hint = ""
        while True:
            try:
                answer = self._ask(
                    f"{hint}How far did it go in {what} [m, backwards is negative]? "
                )
            except EOFError:
                raise Sim2RealError(
                    "nothing tracks the robot, and there is no terminal to enter the distance; "
                    "start in a terminal, or give it a tracker (hardware/body.py)"
                ) from None
            try:
                metres = float(answer.strip().removesuffix("m").replace(",", "."))
            except ValueError:
                metres = math.nan
            if math.isfinite(metres):
                return metres
            hint = f"{answer.strip()!r} is not a number of metres, such as 0.85. "
