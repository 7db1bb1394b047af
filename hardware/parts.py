"""The parts of a robot's file: servos, buses, an IMU, a supply."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from hardware.errors import RobotError, did_you_mean, format_names
from hardware.tables import ServoType, servo_type
from hardware.typed import mapping

IMUS = ("bno085-rvc", "bno055")  # part and mode
QUANTITIES = ("orientation", "gyro", "acceleration")  # that an emulated IMU can measure

COMMON = {"sign": 1, "torque": None}  # of a servo, where its robot's file does not say


@dataclass(frozen=True)
class Supply:
    """A power supply: voltage without load [V], inner resistance [ohm].

    Servos whose supplies are equal hang on one, so that the current of each lowers the voltage of
    all.
    """

    voltage: float
    resistance: float = 0.0


@dataclass(frozen=True)
class Servo:
    """One servo of a robot and the joint it turns."""

    name: str  # the actuator of the model that it stands for
    id: int  # its number on the bus, 0 to 251
    model: str  # its type
    sign: int  # 1 or -1: the direction of its counts along the joint
    zero: float  # the count at the joint's zero; a calibration may put it between two
    position: tuple[float, float]  # least and largest angle to command [rad]
    velocity: float  # fastest motion of a command [rad/s]
    torque: float | None  # largest torque [N·m], None for all it has
    # registers of this servo in addition to the robot's
    registers: Mapping[str, int] = field(default_factory=dict)
    bus: str | None = None  # the name of its bus, where the robot has several
    # largest current [A] that the guard lets it draw for longer than `stops.patience`; None for
    # the servo's own limit
    current: float | None = None
    # the same of a servo that reports its load, as a part of the full one, above 0 to 1
    load: float | None = None
    supply: Supply | None = None  # its own power supply; None for the robot's

    @property
    def type(self) -> ServoType:
        """Its type's data."""
        return servo_type(self.model)

    def angle(self, count: float) -> float:
        """Return the joint's angle [rad] at this count of the encoder."""
        return self.sign * (count - self.zero) * self.type.units.angle

    def count(self, angle: float) -> int:
        """Return the nearest count of the encoder at this angle [rad]."""
        return round(self.zero + self.sign * angle / self.type.units.angle)


@dataclass(frozen=True)
class BusSettings:
    """The serial bus: baud [bits/s], return_delay [s], latency of the USB adapter [s]."""

    baud: int
    return_delay: float
    latency: float


@dataclass(frozen=True)
class Bus(BusSettings):
    """One of several buses: its name and its serial port, None for the emulated one."""

    name: str
    port: str | None = None


@dataclass(frozen=True)
class ImuErrors:
    """Channels and errors of an emulated IMU, along the axes of its site.

    Args:
        measures: the quantities that the robot without ports has, some of QUANTITIES; at a port the
            frames of the part say what there is.
        orientation_noise: standard deviation of each reading's turn about each axis [rad].
        gyro_noise: the same of the angular velocity [rad/s].
        acceleration_noise: the same of the acceleration [m/s^2].
        gyro_bias: what is added to the angular velocity [rad/s].
        acceleration_bias: what is added to the acceleration [m/s^2].
        latency: how old what is read is [s].
    """

    measures: tuple[str, ...] = ("orientation", "gyro")
    orientation_noise: float = 0.0
    gyro_noise: float = 0.0
    acceleration_noise: float = 0.0
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    acceleration_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    latency: float = 0.0


@dataclass(frozen=True)
class Imu:
    """An IMU on a separate serial port."""

    model: str  # part and mode, one of IMUS
    site: str  # of the robot's MJCF, where it is
    # how the part is turned in the site's axes, a unit quaternion w x y z
    mount: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    port: str | None = None  # the serial port, None for none
    emulated: ImuErrors = ImuErrors()  # what the emulated part measures, and how well


def shared_of_servos(data: Any, place: str) -> dict[str, Any]:
    """Return the settings that the servos of a robot share, including those of every robot."""
    known = [one.name for one in fields(Servo) if one.name not in ("name", "id")]
    for key in (data := mapping({} if data is None else data, place)):
        if key not in known:
            hint = did_you_mean(str(key), known)
            raise RobotError(
                f"{place}: unknown key {key!r}{hint}; it can have {format_names(known)}"
            )
    return {**COMMON, **data}
