"""All logs of a diagnosis with the states of their robot's base.

estimates = estimate_all(logs, model, settings)     # [] where every base is held or logged
"""

from collections.abc import Sequence
from pathlib import Path

from hardware.log import Log
from sim2real.diagnosis.data.recording import check_log, load_model
from sim2real.diagnosis.ground.estimate import Estimate, estimated
from sim2real.diagnosis.settings import Ground
from sim2real.runs.errors import Sim2RealError


def estimate_all(logs: Sequence[Log], model: str | Path | None, settings: Ground) -> list[Estimate]:
    """Return the estimate of each log; none at all where no log needs one.

    Args:
        logs: of one robot.
        model: an MJCF for all of them; None takes the one that each log names.
        settings: how sure each channel is.

    Raises:
        Sim2RealError: a base that turns and has no IMU, or one that only some of the logs hold.
        LogError: a log that names what its model lacks.
    """
    found = []
    for log in logs:
        compiled = load_model(log, model).compile()
        check_log(log, compiled)
        found.append(estimated(log, compiled, settings))
    made = [one for one in found if one is not None]
    if made and len(made) < len(logs):
        held = next(log for log, one in zip(logs, found, strict=True) if one is None)
        loose = next(one for one in made)
        raise Sim2RealError(
            f"{held.path or 'a log'} contains the base's position and "
            f"{loose.log.path or 'another'} "
            "does not; diagnose them separately"
        )
    return made
