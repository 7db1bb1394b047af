"""Servos on a bus, the emulator that stands in for them, and the log that everybody shares.

Needs numpy, PyYAML, dynamixel-sdk, pyserial and mujoco; knows neither the simulated worlds nor the
algorithms.

    log.py        the trajectory log: one row a control step
    config.py     a robot's YAML: its model, servos, bus and limits
"""
