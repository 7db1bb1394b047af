"""The names that a trajectory log's columns can have; `hardware/log.py` says what they mean."""

REQUIRED = ("episode", "time")
READING = "reading"  # metadata: what the reader mended, in sentences
IMPEDANCE_KINDS = ("kp", "kd", "qvel_des", "torque_ff")  # of a joint under impedance control
ACTUATOR_KINDS = ("ctrl", "torque", "current", "voltage", "temperature", *IMPEDANCE_KINDS)
JOINT_KINDS = ("qpos", "qvel", "stamp")
SITE_KINDS = ("gyro", "accelerometer", "quat")
KINDS = (*ACTUATOR_KINDS, *JOINT_KINDS, *SITE_KINDS, "sensor", "action", "flag", "obs")
INTEGER_KINDS = ("episode", "torque", "flag")


def known(name: str) -> bool:
    """Say whether a log can have a column of this name."""
    kind, _, rest = name.partition(".")
    return name in (*REQUIRED, "reward") or (kind in KINDS and bool(rest))
