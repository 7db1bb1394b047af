"""Which effects are missing: screened, fitted, judged on held-out data, concluded."""
