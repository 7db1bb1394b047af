"""Names the unmodelled effect that causes a gap between a robot's logs and its simulation."""
