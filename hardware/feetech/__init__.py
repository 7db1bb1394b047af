"""Feetech STS servos behind the same driver, guard and tools as Dynamixel ones.

    protocol.py     packets                        bus_client.py   requests and answers
    driver.py       servos in SI units             sts3215.yaml    control table and motor

`hardware/emulator/feetech.py` emulates them. A robot is one of Feetech servos if its file names
their type, such as `sts3215`.
"""
