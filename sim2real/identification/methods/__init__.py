"""Methods: a provider, a prior and data in, a distribution out."""
