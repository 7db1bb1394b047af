"""What a log says of itself before any physics is blamed.

    findings = preflight(logs, specs)
    [f for f in findings if f.check not in NOTES]       # what should be corrected

Each finding says in plain sentences what was found and what to do about it. Those of `NOTES` only
tell what the sensors are like; every other one should be corrected before a physical cause is
sought.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence

import mujoco

from hardware.log import Log
from sim2real.diagnosis.data.noise_floor import count_of, noise_floor, rounding
from sim2real.diagnosis.preflight import channels
from sim2real.diagnosis.preflight.clocks import check_clocks
from sim2real.diagnosis.preflight.lag import check_lag
from sim2real.diagnosis.preflight.unlogged import check_unlogged
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings

Check = Callable[[Sequence[Log], Sequence[mujoco.MjModel]], Iterable[Finding]]
BLOCKING = ("range", "rate", "no_command")  # such a log says nothing of the robot
NOTES = (
    *("quantization", "noise", "velocity_filter", "unsigned", "computed_torque"),
    *("base", "reading"),
)
ORDER = (*BLOCKING, "excitation")

CHECKS: list[Check] = []  # those of users, after this project's own


def register(check: Check) -> Check:
    """Ask a further check in every preflight; return it, so that this can be a decorator.

    It is given the logs and the compiled model of each, and returns findings.
    """
    CHECKS.append(check)
    return check


def preflight(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return what is wrong with logs and their models, the gravest finding first.

    Logs that share a model share its spec.

    Raises:
        EnvsError: a model that cannot be simulated.
    """
    made = {id(spec): spec.copy().compile() for spec in specs}
    models = [made[id(spec)] for spec in specs]
    pairs = list(zip(logs, models, strict=True))
    found = [finding for check in channels.CHECKS for finding in check(pairs, settings)]
    found += check_clocks(logs, settings)
    if not any(finding.check in BLOCKING for finding in found):
        found += check_lag(pairs, specs, settings)
    if not any(finding.check == "rate" for finding in found):
        found += _noise(logs, settings)
    found += check_unlogged(pairs, specs, settings)
    found += [finding for check in CHECKS for finding in check(logs, models)]
    return sorted(found, key=_rank)


def _noise(logs: Sequence[Log], settings: Settings) -> Iterator[Finding]:
    """Joints whose readings scatter by more than their counts."""
    limits = settings.preflight
    for joint, floor in noise_floor(logs, settings).items():
        least = rounding(max(count_of(logs, joint, settings), limits.count_min))
        if floor > limits.noise * least:
            yield Finding(
                "noise",
                joint,
                f"The positions of {joint} differ by {floor:.2g} (RMS) from what repeats of "
                "the same commands, or neighbouring rows, let expect.",
                "No action needed: no model comes closer than that to a single run.",
            )


def _rank(finding: Finding) -> int:
    if finding.check in ORDER:
        return ORDER.index(finding.check)
    return len(ORDER) + (finding.check in NOTES)
