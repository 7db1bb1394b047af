"""When the guard stops a robot: the thresholds, each a setting of its own.

Guard(driver, StopLimits(odd_voltage=0.3))
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StopLimits:
    """When to stop.

    Args:
        misses: stop after so many readings in a row without one servo's answer.
        hottest: stop this far below the servo's own temperature limit [K].
        stray: stop when a joint is this far from its command [rad], or so far that a soft servo
            drives at full duty if that is further, ...
        patience: ... for this long [s].
        outside: arm only if no joint is further outside its limits than this [rad]; the first
            commands then lead it back in.
        odd_voltage: stop when the supply differs from the robot's file by this part of it.
        return_time: for this long a bus that went away is tried again for torque-off [s].
    """

    misses: int = 5
    hottest: float = 5.0
    stray: float = 0.5
    patience: float = 0.5
    outside: float = 0.2
    odd_voltage: float = 0.2
    return_time: float = 4.0
