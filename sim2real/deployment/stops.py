"""The setting `stops`: when the guard stops a robot, where it differs from the guard's own.

make_stop_limits({"return_time": 10.0})             # StopLimits(return_time=10.0)
"""

from dataclasses import fields

from hardware.errors import did_you_mean
from hardware.stop_limits import PARTS, StopLimits
from sim2real.runs.errors import Sim2RealError


def make_stop_limits(stops: dict[str, float] | None) -> StopLimits:
    """Return when to stop the robot; raises Sim2RealError for a name that a guard does not know."""
    known = [field.name for field in fields(StopLimits)]
    for name, value in (stops or {}).items():
        if name not in known or not isinstance(value, int | float) or not value > 0:
            raise Sim2RealError(
                f"stops.{name}={value}{did_you_mean(name, known)}: expected a number above 0 for "
                f"one of "
                f"{', '.join(known)}"
            )
        if name in PARTS and value > 1:
            raise Sim2RealError(
                f"stops.{name}={value} is a fraction; expected above 0 and at most 1"
            )
    return StopLimits(**(stops or {}))  # type: ignore[arg-type]
