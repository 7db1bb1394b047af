"""Robots of other engines, with separate models of servos, buses, friction, play and springs."""
