"""Robots that other engines move, with servos, buses, friction, play and springs of their own."""
