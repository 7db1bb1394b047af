"""EASI's study: identification from rollouts, and training under what it found."""
