"""An IMU on a separate serial port, named in the robot's file.

    rvc.py      frames of the BNO085 in its mode UART-RVC      reader.py   the IMU as body sensors
    bno055.py   registers of the BNO055, which has a gyro

`hardware/emulator/imu.py` emulates it.
"""
