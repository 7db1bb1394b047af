"""The names that a trajectory log's columns can have; `hardware/log.py` says what they mean."""

from collections.abc import Mapping

from hardware.errors import LogError

REQUIRED = ("episode", "time")
READING = "reading"  # metadata: what the reader mended, in sentences
SOURCE_UNITS = "source_units"  # metadata: the units of a mapping, by column, that only they convert
IMPEDANCE_KINDS = ("kp", "kd", "qvel_des", "torque_ff")  # of a joint under impedance control
ACTUATOR_KINDS = ("ctrl", "torque", "current", "voltage", "temperature", *IMPEDANCE_KINDS)
JOINT_KINDS = ("qpos", "qvel", "stamp")
SITE_KINDS = ("gyro", "accelerometer", "quat")
KINDS = (*ACTUATOR_KINDS, *JOINT_KINDS, *SITE_KINDS, "sensor", "action", "flag", "obs")
OWN_KINDS = ("qpos", "qvel", "current", "temperature", *SITE_KINDS)  # each has its own sensor
INTEGER_KINDS = ("episode", "torque", "flag")


def known(name: str) -> bool:
    """Say whether a log can have a column of this name."""
    kind, _, rest = name.partition(".")
    return name in (*REQUIRED, "reward") or (kind in KINDS and bool(rest))


def check_sources(sources: Mapping[str, str], place: str) -> None:
    """Refuse a measurement that is read from where another one, or a command, is read from.

    Commands may share a source, and so may times, gains, flags and what a policy observes.

    Args:
        sources: where each column is read from.
        place: for the message: the mapping.

    Raises:
        LogError: with the source and both columns.
    """
    first: dict[str, str] = {}
    for name, source in sources.items():
        kind = name.partition(".")[0]
        if kind not in ("ctrl", *OWN_KINDS):
            continue
        other = first.setdefault(source, name)
        if other != name and not kind == other.partition(".")[0] == "ctrl":
            raise LogError(
                f"{place}: {other!r} and {name!r} are both read from {source!r}; only commands "
                "can share a source: name another one, or remove a column"
            )
