"""A bus of servos that is not there: the same bytes, timing and failures over a MuJoCo robot.

    world.py       the robot: servos and physics, one clock
    bus.py         before it: bytes in, bytes out, and when
    servo.py       what a servo answers           memory.py    its control table
    firmware.py    its 1 kHz control loop         control.py   the laws of its modes
    profile.py     the motion of its goal
    mechanics.py   MuJoCo, friction, play         model.py     the edited model
    hidden.py      effects that the robot hides   faults.py    what goes wrong, and when
    loopback.py    as a port of dynamixel-sdk     pty.py       as a device file
    feetech.py     Feetech's registers and bus    wires.py     the bus of a world's maker
    feetech_inner.py  the servos behind them

Nothing here is shared with the simulated worlds, so that a diagnosis can be checked on it.
"""
