"""Robots that stand on the ground: where their base was, from encoders, IMU and contact."""
