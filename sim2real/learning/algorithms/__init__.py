"""Training algorithms, each an `Algorithm` that iterates and can be resumed."""
