"""Providers of simulated data: aligned with a log's commands (`Replay`), or with a policy."""
