"""Deploy, diagnose, retrain, deploy again: what `improve` and the experiments before it share."""
