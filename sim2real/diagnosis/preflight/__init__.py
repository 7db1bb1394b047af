"""Checks of a log before any physics is blamed."""
