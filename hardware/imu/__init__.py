"""An IMU on a serial port of its own, named in the robot's file.

    rvc.py      frames of the BNO085 in its mode UART-RVC      reader.py   the IMU as body sensors

`hardware/emulator/imu.py` emulates it.
"""
