"""Servos on a bus, the emulator that stands in for them, and the log that everybody shares.

    log.py          the trajectory log (formats/: how it and others lie in files)
    robot.py        servos, buses, supplies        calibration.py  zeros, signs, ranges
    config.py       a robot's YAML                 robot_checks.py whether it can be
    tables.py       control tables and motors      protocol.py     packets
    bus_client.py   requests and answers           freshness.py    which answers are new
    registers.py    one register by name           timing.py       how long the bus takes
    port_lock.py    one program a port             rehearsal.py    whether a link may drive
    ending.py       torque off at any end          stop_limits.py  when the guard stops
    scan.py         servos at any speed            setup.py        IDs, speeds and settings
    settings.py     what a servo must be set to    readings.py     what servos report
    feetech/        the same for Feetech servos
    driver.py       servos in SI units             handshake.py    checks before any torque
    safety.py       the hand that moves a robot    pace.py         a fixed rate
    excite.py       motions that show a robot      record.py       a motion as a log
    emulator/       a bus that is not there        connect.py      a driver for either
    backends.py     episodes on a robot            replayed.py     episodes of a log
    body.py         IMU and tracker                episode_log.py  a log of every step
    link.py         periods, overruns, answers     monitor.py      the same live
    rows.py         a task on a robot              exported.py     a policy in NumPy
    env.py          the same for TorchRL           commands.py     python -m hardware
    stand.py        a model in the air             nominal.py      a public model with servos

Needs numpy, PyYAML, dynamixel-sdk, pyserial and mujoco (log.py only numpy); knows neither the
simulated worlds (env.py aside) nor the algorithms. `docs/how-to/set_up_servos.md` is the manual.
"""
