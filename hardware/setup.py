"""Give each servo of a robot its ID, speed and settings, after showing what will be written.

    set_up(robot, client, ask=input, tell=print)

Servos that answer by their ID are compared with the robot's file all at once, and written to after
one yes. Those that are missing are then asked for one by one: a servo fresh from the factory
answers as 1 at 57600 bits/s, and two of them at once as one. Everything written is read back.
"""

from collections.abc import Sequence
from dataclasses import replace

from hardware.bus_client import BusClient
from hardware.command_line import UsageError
from hardware.config import Robot, Servo
from hardware.errors import HardwareError, ServoError, format_names
from hardware.handshake import are_several, check_alone, pinged, several
from hardware.registers import write_register
from hardware.scan import DetectedServo, scan
from hardware.settings import Difference, differences
from hardware.terminal import Ask, Tell


def set_up(robot: Robot, client: BusClient, ask: Ask, tell: Tell) -> None:
    """Find, compare, show, ask, write and verify; the port is left open at the robot's speed.

    Raises:
        SerialPortError: the port cannot be used.
        ServoError: a servo does not answer, refuses, or is of another type.
        HardwareError: a person refused, or no one answered.
    """
    with client.more_patient():  # nothing moves here, and a machine may be busy
        _set_up(robot, client, ask, tell)
    client.open(robot.bus.baud)


def _set_up(robot: Robot, client: BusClient, ask: Ask, tell: Tell) -> None:
    found = list(scan(client, _maker(robot)))
    for each in found:
        tell(str(each))
    there = {servo.name: place for servo in robot.servos if (place := _place(servo, found))}
    write_differences(robot, client, [s for s in robot.servos if s.name in there], there, ask, tell)
    for servo in robot.servos:
        if servo.name not in there:
            place = _alone(robot, client, servo, ask, tell)
            write_differences(robot, client, [servo], {servo.name: place}, ask, tell)
    client.open(robot.bus.baud)
    while away := [servo for servo in robot.servos if not client.ping(servo.id)]:
        names = format_names(f"{servo.id} ({servo.name})" for servo in away)
        _asked(ask, f"not connected: {names}; connect all servos, then press Enter ")


def _maker(robot: Robot) -> str:
    return robot.servos[0].type.maker


def _place(servo: Servo, found: Sequence[DetectedServo]) -> DetectedServo | None:
    """Return where a servo answers by its ID; None if nowhere, or in several places."""
    places = [f for f in found if f.id == servo.id and f.number == servo.type.number]
    return places[0] if len(places) == 1 and not places[0].shared else None


def _alone(robot: Robot, client: BusClient, servo: Servo, ask: Ask, tell: Tell) -> DetectedServo:
    """Ask for a servo to be connected and return where it answers.

    Servos that the robot's file knows already, at their IDs and speed, do no harm unless the new
    one has the ID of one of them.
    """
    known = {s.id: s for s in robot.servos if s.id != servo.id}
    while True:
        _asked(
            ask,
            f"servo {servo.id} ({servo.name}) is missing; connect it alone, a {servo.model}, then "
            "press Enter ",
        )
        found = list(scan(client, _maker(robot)))
        others = [
            f
            for f in found
            if f.baud != robot.bus.baud or f.id not in known or f.number != known[f.id].type.number
        ]
        strange = found if len(found) == 1 else others  # alone it may have another one's ID
        if len(strange) == 1 and strange[0].number == servo.type.number:
            if not strange[0].shared:
                return strange[0]
            tell(several(strange[0].id))
            continue
        tell(f"this needs one new {servo.model}; found: {format_names(map(str, strange))}")


def write_differences(
    robot: Robot,
    client: BusClient,
    servos: Sequence[Servo],
    there: dict[str, DetectedServo],
    ask: Ask,
    tell: Tell,
) -> None:
    """Show what differs in these servos, ask, and write it.

    Args:
        robot: what its servos are to be.
        client: a client of their maker.
        servos: those to look at.
        there: where each answers now, by name.
        ask: asks the person.
        tell: shows a line.

    Raises:
        ServoError: a servo does not answer, or refuses.
        HardwareError: a person refused, or no one answered.
    """
    plans = {servo.name: _plan(robot, client, servo, there[servo.name]) for servo in servos}
    changes = [change for plan in plans.values() for change in plan]
    if not changes:
        return
    tell("to be written, after torque is switched off:")
    for change in changes:
        tell(f"  {change}")
    if _asked(ask, f"write these {len(changes)} values? [y/N] ").strip().lower() not in (
        "y",
        "yes",
    ):
        raise HardwareError("nothing was written")
    for servo in servos:
        if plans[servo.name]:
            _apply(robot, client, servo, there[servo.name], plans[servo.name])
            tell(f"servo {servo.id} ({servo.name}) is set up")


def _plan(robot: Robot, client: BusClient, servo: Servo, found: DetectedServo) -> list[Difference]:
    """Return all that differs in a servo, its ID and its speed last."""
    client.open(found.baud)
    plan = [
        change._replace(servo=servo)
        for change in differences(client, robot, replace(servo, id=found.id))
    ]
    if found.id != servo.id:
        why = "each servo needs its own ID"
        plan.append(Difference(servo, "id", found.id, servo.id, why))
    if found.baud != robot.bus.baud:
        codes = servo.type.bauds
        why = f"{found.baud} -> {robot.bus.baud} bits/s"
        wanted = codes.index(robot.bus.baud)
        plan.append(Difference(servo, "baud_rate", codes.index(found.baud), wanted, why))
    return plan


def _apply(
    robot: Robot, client: BusClient, servo: Servo, found: DetectedServo, plan: Sequence[Difference]
) -> None:
    """Write a plan and look whether the servo is as its robot's file wants it."""
    write_settings(client, servo, found, plan, robot.bus.baud)
    left = differences(client, robot, servo)
    if left:
        raise ServoError(f"{left[0]}, but the servo did not keep it")


def write_settings(
    client: BusClient, servo: Servo, found: DetectedServo, plan: Sequence[Difference], baud: int
) -> None:
    """Write a plan: torque off, settings, then ID, then speed; and look whether it answers.

    Args:
        client: a client of the servo's maker.
        servo: the servo as it will be.
        found: where it answers now.
        plan: what to write.
        baud: the speed at which it will answer.

    Raises:
        ServoError: several servos have its ID, before or afterwards; it refuses, or does not answer
            afterwards.
    """
    client.open(found.baud)
    check_alone(client, found.id)
    now = replace(servo, id=found.id)
    write_register(client, now, "torque_enable", 0)
    if "lock" in servo.type.registers:  # what is written while it is set is lost with the supply
        write_register(client, now, "lock", 0)
    for change in plan:
        if change.register not in ("id", "baud_rate"):
            write_register(client, now, change.register, change.wanted)
    for change in plan:
        if change.register in ("id", "baud_rate"):
            register = servo.type.register(change.register)
            client.write(now.id, register.address, register.encode(change.wanted))
            now = servo if change.register == "id" else now
    client.open(baud)
    replies = pinged(client, servo.id)
    if are_several(replies):
        raise ServoError(several(servo.id))
    if not replies:
        raise ServoError(
            f"servo {servo.id} ({servo.name}) does not answer at its new ID and speed; "
            "python -m hardware scan port=... finds it"
        )
    if "lock" in servo.type.registers:
        write_register(client, servo, "lock", 1)


def _asked(ask: Ask, question: str) -> str:
    try:
        return ask(question)
    except EOFError:
        raise UsageError(
            "setup needs a person at a terminal, but there is none; nothing was written"
        ) from None
