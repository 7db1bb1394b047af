"""Scores: real and simulated data in, one number a simulation out, the smaller the better."""
