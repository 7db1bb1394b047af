"""What simulates: aligned with a log's commands (`Replay`), or with a policy that acts."""
