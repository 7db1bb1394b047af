"""Logs as data: windows, folds, noise floors, and their simulation."""
